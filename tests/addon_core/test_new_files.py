# SPDX-License-Identifier: GPL-3.0-or-later
"""Files take their places together or not at all."""

import os
from pathlib import Path

import pytest

from addon.core.errors import InputError
from addon.core.new_files import NewFiles


def tree(folder: Path) -> dict[str, str]:
    return {str(p.relative_to(folder)): p.read_text() if p.is_file() else "" for p in sorted(folder.rglob("*"))}


def test_all_are_moved(tmp_path: Path) -> None:
    (tmp_path / "old").write_text("old")
    with NewFiles() as files:
        for name in ("old", "deep/er/new"):
            files.add(tmp_path / name, 3).write_text(name)
        assert (tmp_path / "old").read_text() == "old"
        files.commit()
    assert tree(tmp_path) == {"old": "old", "deep": "", "deep/er": "", "deep/er/new": "deep/er/new"}


def test_without_commit_nothing_is_left(tmp_path: Path) -> None:
    (tmp_path / "old").write_text("old")
    before = tree(tmp_path)
    with NewFiles() as files:
        files.add(tmp_path / "old", 3).write_text("new")
        files.add(tmp_path / "deep" / "er" / "new", 3).write_text("new")
    assert tree(tmp_path) == before


def test_a_move_that_fails_takes_the_others_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("a", "b"):
        (tmp_path / name).write_text("old")
    before = tree(tmp_path)
    original = os.replace

    def failing(source: Path, target: Path) -> None:
        if Path(target).name == "c":
            raise PermissionError(13, "Permission denied")
        original(source, target)

    monkeypatch.setattr(os, "replace", failing)
    with NewFiles() as files:
        for name in ("a", "b", "c"):
            files.add(tmp_path / name, 3).write_text("new")
        with pytest.raises(PermissionError):
            files.commit()
    assert tree(tmp_path) == before


def test_places_that_cannot_be(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    with NewFiles() as files:
        with pytest.raises(InputError, match="is a folder"):
            files.add(tmp_path / "folder", 1)
        with pytest.raises(InputError, match=r"needs .* MB"):
            files.add(tmp_path / "large", 10**18)
    assert tree(tmp_path) == {"folder": ""}
