# SPDX-License-Identifier: GPL-3.0-or-later
"""Jobs of a recipe on a Dask cluster of three processes: what one process gives, whatever happens to a worker."""

import json
import sys
import threading
import time

import bakes as b
import bpy
import characters as c
import commands as k
import pytest
from scratch_profile import MODULE

pytest.importorskip("distributed")
psutil = pytest.importorskip("psutil")  # comes with it

AVATARS = {"anna": 16, "bert": 20}
GARMENTS = {"shirt": (10, 14), "coat": (9, 16)}


@pytest.fixture
def recipe(tmp_path):
    """Avatars that move, and bare garments for each: weights, and a cache of the skin."""
    for name, segments in AVATARS.items():
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        b.animated_limb(segments=segments)
        k.save(tmp_path / f"{name}.blend")
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    for name, (segments, rings) in GARMENTS.items():
        c.mesh_object(name, *c.tube(segments, rings, radius=0.65))
    k.save(tmp_path / "garments.blend")
    data = {
        "version": 1,
        "for_each": {"avatar": list(AVATARS), "garment": list(GARMENTS)},
        "open": "{avatar}.blend",
        "append": [{"file": "garments.blend", "objects": ["{garment}"]}],
        "steps": [
            {"command": "retarget", "source": "Limb", "targets": ["{garment}"]},
            {
                "command": "bake",
                "objects": ["Limb"],
                "options": {"directory": "//OUT/{avatar}_{garment}", "play": False},
            },
        ],
        "output": "OUT/{avatar}_{garment}.blend",
    }

    def written(out):
        path = tmp_path / f"{out}.json"
        path.write_text(json.dumps(data).replace("OUT", out))
        return path

    return written


def results(folder):
    """Caches as bytes, and weights exactly."""
    caches = {path.parent.name: path.read_bytes() for path in sorted(folder.rglob("*.pc2"))}
    weights = {}
    for path in sorted(folder.glob("*.blend")):
        weights[path.stem] = k.groups(k.opened(path)[path.stem.split("_")[1]])
    assert len(caches) == len(weights) == len(AVATARS) * len(GARMENTS)
    return caches, weights


def test_the_same_results_when_a_worker_dies(recipe, scheduler, workers, tmp_path, monkeypatch):
    """One of three is killed when the first job is done and the others are under way."""
    k.run("run", recipe("here"))
    module = sys.modules[f"{MODULE}.batch.spread"]
    say, killed = module.say, threading.Event()

    def watched(text):
        if not killed.is_set():
            killed.set()
            workers[0].kill()
        say(text)

    monkeypatch.setattr(module, "say", watched)
    output = k.run("run", recipe("there"), "--dask", scheduler, "--report", tmp_path / "report.json")
    assert workers[0].wait(10) != 0
    names = [f"avatar={avatar},garment={garment}" for avatar in AVATARS for garment in GARMENTS]
    assert all(f"Dermis: {name} (" in output for name in names)
    report = k.report(tmp_path / "report.json")
    assert [(job["name"], job["status"]) for job in report["jobs"]] == [(name, "done") for name in names]
    assert [step["command"] for step in report["jobs"][0]["steps"]] == ["retarget", "bake"]
    assert results(tmp_path / "there") == results(tmp_path / "here")


@pytest.mark.usefixtures("workers")
def test_a_job_that_fails_and_one_that_has_no_result(recipe, scheduler, tmp_path, monkeypatch):
    path = recipe("out")
    (tmp_path / "anna.blend").unlink()
    k.run("run", path, "--dask", scheduler, "--report", tmp_path / "report.json", code=1)
    states = [job["status"] for job in k.report(tmp_path / "report.json")["jobs"]]
    assert states == ["failed", "failed", "done", "done"]
    assert sorted(file.name for file in (tmp_path / "out").glob("*.blend")) == ["bert_coat.blend", "bert_shirt.blend"]
    module = sys.modules[f"{MODULE}.batch.spread"]
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "__main__.py").write_text("no Python")
    packed = module.packed
    monkeypatch.setattr(module, "packed", lambda _: packed(tmp_path / "broken"))
    output = k.run("run", path, "--dask", scheduler, "--report", tmp_path / "report.json", code=1)
    assert "A worker of" in output
    assert "SyntaxError" in output
    assert {job["status"] for job in k.report(tmp_path / "report.json")["jobs"]} == {"failed"}
    assert "SyntaxError" in k.report(tmp_path / "report.json")["jobs"][3]["error"]


def test_stopped_leaves_nothing(recipe, scheduler, workers, tmp_path, monkeypatch):
    """Ctrl+C while the jobs run ends their processes."""
    cluster = sys.modules[f"{MODULE}.core.cluster"].Cluster

    def children():
        return [child for process in workers for child in psutil.Process(process.pid).children()]

    def interrupted(_):
        if children():
            raise KeyboardInterrupt
        return len(workers)

    monkeypatch.setattr(cluster, "_workers", interrupted)
    output = k.run("run", recipe("out"), "--dask", scheduler, code=1)
    assert "stopped; what was not saved yet is not written" in output
    for _ in range(100):
        if not children():
            break
        time.sleep(0.1)
    assert children() == []
    assert not list((tmp_path / "out").glob("*.blend"))


def test_no_worker(recipe, scheduler, tmp_path):
    assert "has no worker: start some" in k.run("run", recipe("out"), "--dask", scheduler, code=1)
    assert not (tmp_path / "out").exists()
