"""The version has one place, and the extension's manifest keeps the platform's rules."""

from __future__ import annotations

import re
import tomllib
from importlib.metadata import version as installed_version
from typing import Any

import dermis_native
import project
import pytest
from checkout import ROOT


def read_toml(name: str) -> dict[str, Any]:
    return tomllib.loads((ROOT / name).read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def manifest() -> dict[str, Any]:
    return read_toml("addon/blender_manifest.toml")


@pytest.fixture(scope="module")
def version() -> str:
    return str(read_toml("Cargo.toml")["workspace"]["package"]["version"])


def test_every_version_is_the_workspace_version(manifest: dict[str, Any], version: str) -> None:
    assert project.version() == version
    assert manifest["version"] == version
    assert dermis_native.__version__ == version
    assert installed_version("dermis_native") == version
    for crate in ("native/core", "native/python"):
        assert read_toml(f"{crate}/Cargo.toml")["package"]["version"] == {"workspace": True}
    assert "version" in read_toml("native/python/pyproject.toml")["project"]["dynamic"]


def test_the_changelog_knows_the_version(version: str) -> None:
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.search(rf"^## \[({re.escape(version)}|Unreleased)\]", text, re.MULTILINE)


def test_licences_are_those_of_the_two_halves(manifest: dict[str, Any]) -> None:
    assert manifest["license"] == ["SPDX:GPL-3.0-or-later"]
    assert read_toml("Cargo.toml")["workspace"]["package"]["license"] == "MIT OR Apache-2.0"
    assert read_toml("native/python/pyproject.toml")["project"]["license"] == "MIT OR Apache-2.0"


def test_manifest_identity(manifest: dict[str, Any]) -> None:
    assert manifest["schema_version"] == "1.0.0"
    assert manifest["id"] == "dermis"
    assert manifest["type"] == "add-on"
    assert manifest["blender_version_min"] == "4.2.0"
    assert "blender" not in manifest["name"].lower()


def test_manifest_texts(manifest: dict[str, Any]) -> None:
    for text in [manifest["tagline"], *manifest.get("permissions", {}).values()]:
        assert 0 < len(text) <= 64
        assert text[-1].isalnum() or text[-1] == ")"


def test_manifest_asks_for_no_more_than_it_needs(manifest: dict[str, Any]) -> None:
    assert set(manifest.get("permissions", {})) <= {"files"}


def test_wheels_are_listed_only_by_the_build(manifest: dict[str, Any]) -> None:
    assert manifest.get("wheels", []) == []
    assert "platforms" not in manifest
