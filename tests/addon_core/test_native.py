# SPDX-License-Identifier: GPL-3.0-or-later
"""What is said about a native module that cannot be used."""

import sys
from types import ModuleType

from addon.core.native import manifest_version, native_problem


def test_missing():
    lines = native_problem("dermis_native_that_is_missing")
    assert lines[0] == "The native module could not be loaded."
    assert "dermis_native_that_is_missing" in lines[-1]


def test_other_version(monkeypatch):
    module = ModuleType("dermis_native_of_old")
    monkeypatch.setitem(sys.modules, module.__name__, module)
    assert "unknown" in native_problem(module.__name__)[0]
    module.__version__ = "0.0.1"
    assert native_problem(module.__name__)[0] == f"Dermis {manifest_version()} found the native module 0.0.1."
    module.__version__ = manifest_version()
    assert native_problem(module.__name__) == []
