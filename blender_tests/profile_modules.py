# SPDX-License-Identifier: GPL-3.0-or-later
"""The native module as the installed zip brings it, whatever else the environment has."""

import importlib.machinery
import sys

from scratch_profile import PROFILE


class OnlyFromTheProfile:
    """Finds the native module in the profile alone."""

    @staticmethod
    def find_spec(name, _path=None, _target=None):
        if name != "dermis_native":
            return None
        inside = [folder for folder in sys.path if folder.startswith(PROFILE)]
        spec = importlib.machinery.PathFinder.find_spec(name, inside)
        if spec is None:
            raise ModuleNotFoundError(f"No module named {name!r} in the profile", name=name)
        return spec
