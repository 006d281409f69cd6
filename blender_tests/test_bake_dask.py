# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames solved by a Dask cluster of three processes: the same bytes, whatever happens to a worker."""

import sys
import threading
from pathlib import Path

import bakes as b
import bpy
import characters as c
import pytest
from scratch_profile import MODULE

pytest.importorskip("distributed")

FRAMES = 240


@pytest.fixture
def limb(tmp_path):
    ob, rig = b.animated_limb()
    b.saved(tmp_path)
    bpy.context.scene.frame_start, bpy.context.scene.frame_end = 1, FRAMES
    c.activate(rig)
    return ob


def baked(folder, **options):
    folder.mkdir()
    assert bpy.ops.dermis.bake(directory=str(folder), play=False, **options) == {"FINISHED"}
    (path,) = folder.iterdir()
    return path.read_bytes()


@pytest.mark.usefixtures("limb")
def test_the_same_bytes_when_a_worker_dies(scheduler, workers, tmp_path, monkeypatch):
    """One of three is killed when about a third is done."""
    here = baked(tmp_path / "here")
    module = sys.modules[f"{MODULE}.core.bake_task"]
    step, killed = module.CacheTask._step, threading.Event()

    def watched(task, fraction):
        if fraction > 0.3 and not killed.is_set():
            killed.set()
            workers[0].kill()
        step(task, fraction)

    monkeypatch.setattr(module.CacheTask, "_step", watched)
    assert baked(tmp_path / "there", dask=scheduler) == here
    assert killed.is_set()
    assert workers[0].wait(10) != 0


@pytest.mark.usefixtures("limb", "workers")
def test_cancelled_leaves_nothing(scheduler, tmp_path, monkeypatch):
    module = sys.modules[f"{MODULE}.core.bake_task"]
    step = module.CacheTask._step

    def cancelled(task, fraction):
        if fraction > 0.1:
            task.cancel()
        step(task, fraction)

    monkeypatch.setattr(module.CacheTask, "_step", cancelled)
    folder = tmp_path / "there"
    folder.mkdir()
    assert bpy.ops.dermis.bake(directory=str(folder), play=False, dask=scheduler) == {"CANCELLED"}
    assert list(folder.iterdir()) == []


@pytest.mark.usefixtures("limb")
def test_no_worker(scheduler, tmp_path):
    with pytest.raises(RuntimeError, match="has no worker: start some"):
        bpy.ops.dermis.bake(directory=str(tmp_path), play=False, dask=scheduler)


@pytest.mark.usefixtures("limb")
@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense://"])
def test_no_scheduler(tmp_path, monkeypatch, address):
    monkeypatch.setattr(sys.modules[f"{MODULE}.core.cluster"], "CONNECT_SECONDS", 1)
    with pytest.raises(RuntimeError, match="There is no Dask scheduler at"):
        bpy.ops.dermis.bake(directory=str(tmp_path), play=False, dask=address)


@pytest.mark.usefixtures("limb")
def test_without_the_package(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(RuntimeError, match=r"install it with .* -m pip install distributed"):
        bpy.ops.dermis.bake(directory=str(tmp_path), play=False, dask="tcp://127.0.0.1:1")
    assert not list(Path(tmp_path).glob("*.pc2"))
