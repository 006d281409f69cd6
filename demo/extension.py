# SPDX-License-Identifier: GPL-3.0-or-later
"""A Blender with the built extension, in a profile of its own.

Import this before anything else that imports bpy: Blender reads where its profile is at its start.
"""

from __future__ import annotations

import os
import sys
import tempfile
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

PROFILE = tempfile.TemporaryDirectory(prefix="dermis-demo-")
os.environ["BLENDER_USER_RESOURCES"] = PROFILE.name

import bpy  # noqa: E402

DIST = Path(__file__).resolve().parents[1] / "dist"


def built_zip() -> Path:
    """The extension that `make zip` built."""
    found = sorted(DIST.glob("dermis-*.zip"))
    if len(found) != 1:
        raise FileNotFoundError(f"dist/ holds {len(found)} extension zips instead of one; run: make zip")
    return found[0]


def install(path: Path) -> str:
    """Install and enable the zip; returns the place of the native module that it brought."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    packages = Path(bpy.utils.user_resource("EXTENSIONS")) / ".local" / "lib"
    packages /= f"python{sys.version_info[0]}.{sys.version_info[1]}/site-packages"
    # The zip's own wheel goes before a copy that this Python may have. A folder that is not there
    # is taken off the path again.
    packages.mkdir(parents=True)
    sys.path.insert(0, str(packages))
    bpy.ops.extensions.package_install_files(
        filepath=str(path), repo="user_default", enable_on_install=True, overwrite=True
    )
    # A zip for another platform is installed without complaint and does nothing.
    if not hasattr(bpy.types, "DERMIS_OT_retarget_weights"):
        raise RuntimeError(f"{path.name} was not installed; was it built for this platform?")
    import dermis_native

    place = str(dermis_native.__file__)
    if not place.startswith(str(packages)):
        raise RuntimeError(f"the native module comes from {place}, not from {path.name}")
    return place


def run(main: Callable[[], None]) -> NoReturn:
    """Run a program to the end of the process: status 0, or 1 and a traceback when it raises."""
    status = 1
    try:
        main()
        status = 0
    finally:
        if status:
            traceback.print_exc()
        PROFILE.cleanup()
        sys.stdout.flush()
        sys.stderr.flush()
        # Blender as a module may hang at its own exit while an add-on is enabled.
        os._exit(status)
