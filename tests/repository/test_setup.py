"""The set-up steps: what they ask of the machine, what they say, and when they run again."""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import sys
from pathlib import Path

import project
import pytest
import setup_environment


def test_another_python_is_told_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "version_info", (3, 12, 1))
    with pytest.raises(SystemExit):
        setup_environment.check_python()
    message = capsys.readouterr().err
    assert "Python 3.12" in message
    assert "python3.11" in message
    assert "make PYTHON=" in message


def test_missing_rust_is_named(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(shutil, "which", lambda _: None)
    with pytest.raises(SystemExit):
        setup_environment.check_rust()
    assert "cargo" in capsys.readouterr().err


def test_missing_libraries_become_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    def load(name: str) -> None:
        if name in ("libSM.so.6", "libXi.so.6"):
            raise OSError(name)

    monkeypatch.setattr(ctypes, "CDLL", load)
    monkeypatch.setattr(shutil, "which", lambda name: None if name == "cc" else name)
    assert setup_environment.missing_system_packages() == ["build-essential", "libsm6", "libxi6"]


def test_without_root_the_exact_command_is_printed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    monkeypatch.setattr(shutil, "which", lambda name: name)
    with pytest.raises(SystemExit):
        setup_environment.install_system_packages(["libsm6", "libxi6"])
    expected = "sudo apt-get update && sudo apt-get install --yes --no-install-recommends libsm6 libxi6"
    assert expected in capsys.readouterr().err


def test_the_makefile_and_the_script_accept_the_same_pythons() -> None:
    makefile = (project.ROOT / "Makefile").read_text(encoding="utf-8")
    named = set(re.findall(r"\((\d), (\d+)\)", makefile))
    assert {(int(major), int(minor)) for major, minor in named} == set(setup_environment.PYTHONS)


def test_every_requirement_is_pinned() -> None:
    for path in (setup_environment.REQUIREMENTS, setup_environment.DATA_REQUIREMENTS):
        for line in path.read_text(encoding="utf-8").splitlines():
            assert not line or line.startswith("#") or re.match(r"[\w-]+==[\d.]+(; .+)?$", line), line


def test_fingerprint_follows_names_contents_and_texts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(project, "ROOT", tmp_path)
    first, second = tmp_path / "a", tmp_path / "b"
    first.write_text("1", encoding="utf-8")
    second.write_text("2", encoding="utf-8")
    before = project.fingerprint([first, second], "x")
    assert project.fingerprint([second, first], "x") == before
    assert project.fingerprint([first, second], "y") != before
    assert project.fingerprint([first], "x") != before
    second.write_text("3", encoding="utf-8")
    assert project.fingerprint([first, second], "x") != before


def test_a_step_counts_as_done_only_after_it_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(project, "STAMPS", tmp_path / "stamps")
    assert not project.is_done("step", "hash")
    project.mark_done("step", "hash")
    assert project.is_done("step", "hash")
    assert not project.is_done("step", "other")
    project.forget("step")
    assert not project.is_done("step", "hash")


def test_a_failing_command_ends_the_set_up(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        project.run([sys.executable, "-c", "raise SystemExit(7)"])
    assert "exit status 7" in capsys.readouterr().err
