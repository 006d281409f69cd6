# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs `python -m dermis` where no `dermis_native` is installed but the one that Blender unpacked.

Arguments: the folder that holds the extension, and those of the command. Run by the tests.
"""

import importlib.machinery
import runpy
import sys
import sysconfig

folder = sys.argv.pop(1)
INSTALLED = {sysconfig.get_paths()["purelib"], sysconfig.get_paths()["platlib"]}


class NotInstalled:
    """Finds the native module anywhere but among the installed packages."""

    @staticmethod
    def find_spec(name, _path=None, _target=None):
        if name != "dermis_native":
            return None
        spec = importlib.machinery.PathFinder.find_spec(name, [place for place in sys.path if place not in INSTALLED])
        if spec is None:
            raise ModuleNotFoundError(name)
        return spec


sys.meta_path.insert(0, NotInstalled)
sys.path.insert(0, folder)
runpy.run_module("dermis", run_name="__main__")
