# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender as a module, with the built zip installed into a scratch profile.

The tests see what a user sees: the extension in Blender's own folder, its native module from the
wheel in the zip, real operators.
"""

import os
import shutil
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from scratch_profile import MODULE, PROFILE  # isort: skip  (before bpy)
from profile_modules import OnlyFromTheProfile  # isort: skip

import bpy
import dask_cluster

DIST = Path(__file__).resolve().parent.parent / "dist"


def extension_zip() -> Path:
    """The newest zip in dist/, or the one that DERMIS_ZIP names."""
    chosen = os.environ.get("DERMIS_ZIP")
    found = [Path(chosen)] if chosen else sorted(DIST.glob("dermis-*.zip"), key=lambda path: path.stat().st_mtime)
    if not found:
        pytest.exit("there is no dist/dermis-*.zip: run `make zip` first", returncode=3)
    return found[-1]


@pytest.fixture(scope="session")
def addon():
    """The installed and enabled extension: its package in Blender."""
    sys.meta_path.insert(0, OnlyFromTheProfile)
    status = bpy.ops.extensions.package_install_files(
        filepath=str(extension_zip()), repo="user_default", enable_on_install=True, overwrite=True
    )
    assert status == {"FINISHED"}
    assert MODULE in bpy.context.preferences.addons, "the zip was not installed: is it for this platform?"
    return sys.modules[MODULE]


@pytest.fixture(autouse=True)
def empty_scene(addon):
    """An empty file for each test; the extension stays enabled."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert MODULE in bpy.context.preferences.addons
    return addon


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory):
    """The address of a Dask scheduler without workers."""
    with dask_cluster.scheduler(tmp_path_factory.mktemp("scheduler")) as address:
        yield address


@pytest.fixture
def workers(scheduler, tmp_path_factory):
    """Three processes that work for it."""
    with dask_cluster.workers(scheduler, tmp_path_factory.mktemp("workers")) as processes:
        yield processes


_status = 0


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(exitstatus):
    global _status
    _status = int(exitstatus)


@pytest.hookimpl(trylast=True)
def pytest_unconfigure():
    # Blender as a module hangs or crashes at exit while add-ons are enabled.
    shutil.rmtree(PROFILE, ignore_errors=True)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(_status)
