# SPDX-License-Identifier: GPL-3.0-or-later
"""Dermis without a Blender program: `python -m dermis` beside this folder, or `python FOLDER`.

Needs the package `bpy`, and the native module: installed, or where Blender unpacks it for this extension.
"""

import importlib
import os
import sys
import traceback
from pathlib import Path

FOLDER = Path(__file__).resolve().parent


def main() -> int:
    """Register without a preference or a profile, run, take everything back."""
    if not __package__:
        sys.path[0] = str(FOLDER.parent)
    name = __package__ or FOLDER.name
    unpacked = FOLDER.parent.parent / ".local" / "lib" / "python{}.{}".format(*sys.version_info) / "site-packages"
    if unpacked.is_dir():
        sys.path.append(str(unpacked))
    try:
        importlib.import_module("bpy")
    except ImportError as error:
        print(f"Dermis needs Blender as a Python module: pip install bpy ({error})", file=sys.stderr)
        return 1
    package = importlib.import_module(name)
    problem = importlib.import_module(f"{name}.core.native").native_problem()
    if problem:
        print("\n".join(problem), file=sys.stderr)
        return 1
    package.register()
    try:
        return importlib.import_module(f"{name}.batch.command").main(sys.argv[1:], f"python -m {name}")
    finally:
        package.unregister()


if __name__ == "__main__":
    status = 1
    try:
        status = main()
    except BaseException:  # noqa: BLE001  (it is shown; Blender as a module may hang at a regular exit)
        traceback.print_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)
