"""The one summary line counts what really ran."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
import run_tests

CARGO = """running 3 tests
test mesh::a ... ok
test mesh::b ... FAILED
test mesh::c ... ignored
test result: FAILED. 1 passed; 1 failed; 1 ignored; 0 measured; 0 filtered out; finished in 0.00s
running 1 test
test src/lib.rs - d (line 3) ... ok
test result: ok. 1 passed; 0 failed; 0 ignored; 0 measured; 0 filtered out; finished in 0.00s
"""
JUNIT = """<testsuites><testsuite>
<testcase classname="tests.m" name="a"/>
<testcase classname="tests.m" name="b"><failure>no</failure></testcase>
<testcase classname="tests.m" name="c"><skipped/></testcase>
<testcase classname="tests.m" name="d"><error>no</error></testcase>
</testsuite></testsuites>"""


def test_cargo_output_is_summed_over_its_binaries() -> None:
    assert run_tests.cargo_counts(CARGO) == run_tests.Counts(passed=2, skipped=1, failed=["mesh::b"])


def test_pytest_report_is_counted(tmp_path: Path) -> None:
    report = tmp_path / "report.xml"
    report.write_text(JUNIT, encoding="utf-8")
    assert run_tests.junit_counts(report) == run_tests.Counts(passed=1, skipped=1, failed=["tests.m::b", "tests.m::d"])


def test_output_and_status_of_a_command_are_kept(capfd: pytest.CaptureFixture[str]) -> None:
    status, output = run_tests.run_live([sys.executable, "-c", "print('seen'); raise SystemExit(3)"])
    assert (status, output) == (3, "seen\n")
    assert "seen" in capfd.readouterr().out


def test_a_suite_without_a_report_counts_as_failed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_tests, "run_live", lambda *_: (139, ""))
    assert run_tests.pytest("tests").failed == ["pytest tests ended with status 139"]
    assert run_tests.rust().failed == ["cargo test did not run to its end"]


def test_one_failure_fails_the_whole(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    suites = {
        "rust": lambda: run_tests.Counts(passed=4),
        "lint": lambda: run_tests.Counts(passed=1, failed=["clippy"]),
    }
    monkeypatch.setattr(run_tests, "SUITES", suites)
    monkeypatch.setattr(sys, "argv", ["run_tests.py"])
    assert run_tests.main() == 1
    output = capsys.readouterr().out
    assert "FAILED  lint: clippy" in output
    assert output.endswith("5 passed, 1 failed\n")
