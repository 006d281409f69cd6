"""Every file is of a readable length, says its licence, and is finished."""

from __future__ import annotations

import re

import pytest
from checkout import ROOT, relative, shipped_files

MOST_LINES = 450
SOURCES = (".py", ".pyi", ".rs")
GENERATED = {"Cargo.lock"}


def test_no_file_is_too_long() -> None:
    lengths = {relative(path): len(path.read_text(encoding="utf-8").splitlines()) for path in shipped_files(*SOURCES)}
    assert lengths
    assert {name: length for name, length in lengths.items() if length > MOST_LINES} == {}


@pytest.mark.parametrize("folder", ["addon", "blender_tests"])
def test_blender_sources_carry_the_gpl(folder: str) -> None:
    for path in shipped_files(".py"):
        if path.is_relative_to(ROOT / folder):
            first = path.read_text(encoding="utf-8").split("\n", 1)[0]
            assert first == "# SPDX-License-Identifier: GPL-3.0-or-later", relative(path)


def test_licence_texts_are_complete() -> None:
    for name, first, least in [
        ("LICENSE-MIT", "MIT License", 1000),
        ("LICENSE-APACHE", "Apache License", 10000),
        ("addon/LICENSE", "GNU GENERAL PUBLIC LICENSE", 30000),
    ]:
        text = (ROOT / name).read_text(encoding="utf-8")
        assert first in text[:200], name
        assert len(text) > least, name


def test_nothing_is_left_for_later() -> None:
    pattern = re.compile(r"\b(" + "|".join(["TO" + "DO", "FIX" + "ME", "X" * 3]) + r")\b")
    for path in shipped_files(*SOURCES, ".toml", ".md", ""):
        if path.name not in GENERATED and not path.name.startswith("LICENSE"):
            found = pattern.search(path.read_text(encoding="utf-8"))
            assert found is None, f"{relative(path)}: {found and found.group(0)}"


def test_no_source_names_a_place_on_one_machine() -> None:
    pattern = re.compile(r"(?<![\w.}/])/(home|root|Users|work|tmp|opt)/\w")
    for path in shipped_files(*SOURCES, ".toml", ".md"):
        found = pattern.search(path.read_text(encoding="utf-8"))
        assert found is None, f"{relative(path)}: {found and found.group(0)}"


def test_every_rust_source_says_what_it_holds() -> None:
    for path in shipped_files(".rs"):
        if "src" in path.parts:
            assert path.read_text(encoding="utf-8").startswith("//!"), relative(path)
