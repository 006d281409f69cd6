"""What the documents tell a reader to type or to open exists."""

from __future__ import annotations

import re
from pathlib import Path

import api_page
import pytest
from checkout import ROOT, relative, shipped_files

DOCUMENTS = [path for path in shipped_files(".md") if path.parent in (ROOT, ROOT / "docs")]


def make_targets() -> set[str]:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    return set(re.findall(r"^([a-z-]+):.*## ", makefile, re.MULTILINE))


@pytest.mark.parametrize("document", DOCUMENTS, ids=relative)
def test_commands_exist(document: Path) -> None:
    text = document.read_text(encoding="utf-8")
    named = set(re.findall(r"(?:^|`|\n)make(?: [A-Z]+=\S+)* ([a-z-]+)", text))
    assert named <= make_targets()
    for script in re.findall(r"\b(?:scripts|bench|demo)/[\w/]+\.py\b", text):
        assert (ROOT / script).is_file(), script


@pytest.mark.parametrize("document", DOCUMENTS, ids=relative)
def test_links_lead_somewhere(document: Path) -> None:
    for link in re.findall(r"\]\(([^)#]+)[^)]*\)", document.read_text(encoding="utf-8")):
        if "://" not in link:
            assert (document.parent / link).exists(), link


def test_the_readme_starts_with_the_two_commands() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert {"make demo", "make test"} <= set(re.findall(r"^(?:    )?(make \w+)", text, re.MULTILINE))


def test_every_target_says_what_it_does() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    phony = re.search(r"^\.PHONY: (.*)$", makefile, re.MULTILINE)
    assert phony is not None
    assert set(phony.group(1).split()) == make_targets()


def test_the_drawing_shows_every_folder_of_the_core() -> None:
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    drawn = set(re.findall(r'\["(\w+)/<br>', text))
    folders = {path.name for path in (ROOT / "native" / "core" / "src").iterdir() if path.is_dir()}
    assert folders <= drawn


@pytest.mark.parametrize("document", DOCUMENTS, ids=relative)
def test_files_of_the_core_exist(document: Path) -> None:
    names = {path.name for path in (ROOT / "native" / "core" / "src").rglob("*.rs")}
    named = set(re.findall(r"`(?:[\w/]+/)?(\w+\.rs)`", document.read_text(encoding="utf-8")))
    assert named <= names


def test_the_api_page_is_the_stub() -> None:
    assert api_page.OUTPUT.read_text(encoding="utf-8") == api_page.page(), "run: make format"
