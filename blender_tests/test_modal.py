# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator in a window: a thread works, timer events watch it, ESC stops it."""

import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import bpy
import characters as c
import pytest
from scratch_profile import MODULE
from windows import Context, event, held, in_window, stand_in_for, until_ended


@pytest.fixture
def operator():
    return stand_in_for("retarget_weights")


@pytest.fixture
def gate(monkeypatch):
    """Retargeting that waits until it is let through or cancelled."""
    yield from held(monkeypatch, "task", "find_weights")


@pytest.fixture
def scene(monkeypatch):
    in_window(monkeypatch)
    source, _ = c.source_tube()
    target = c.target_tube()
    c.activate(source, target)
    bpy.context.view_layer.update()
    return target


def test_ends_with_the_weights(operator, gate, scene):
    context = Context()
    before = c.state(scene)
    assert operator.invoke(context, None) == {"RUNNING_MODAL"}
    assert context.window_manager.handlers == [operator]
    assert operator.modal(context, event("MOUSEMOVE")) == {"RUNNING_MODAL"}
    assert operator.modal(context, event("TIMER")) == {"RUNNING_MODAL"}
    assert "ESC" in context.status
    assert c.state(scene) == before
    gate.set()
    assert until_ended(operator, context) == {"FINISHED"}
    assert c.state(scene)["weights"] != before["weights"]
    assert [kind for kind, _ in operator.reports] == ["INFO"]
    assert context.status is None
    assert context.window_manager.timers == []
    assert context.window_manager.progress[-1] == "end"


@pytest.fixture
def stuck(monkeypatch):
    """Native calls, of retargeting and of binding, that look at nothing until they are let through.

    `entered` is released once for each call that has begun, `results` holds what each gave.
    """
    gate = SimpleNamespace(opened=threading.Event(), entered=threading.Semaphore(0), results=[])
    for name in ("task", "bind"):
        module = sys.modules[f"{MODULE}.core.{name}"]

        def waiting(*arguments, call=module.find_weights):
            gate.entered.release()
            assert gate.opened.wait(60)
            gate.results.append(call(*arguments))
            return gate.results[-1]

        monkeypatch.setattr(module, "find_weights", waiting)
    monkeypatch.setattr(sys.modules[f"{MODULE}.ui.modal_job"], "PATIENCE_SECONDS", 0.0)
    yield gate
    gate.opened.set()
    end_all()


def end_all():
    sys.modules[f"{MODULE}.core.background"].end_all()


def working_threads():
    return [thread for thread in threading.enumerate() if thread.name.startswith("dermis-")]


def assert_left(operator, context):
    """The operator has told that it was cancelled and has taken back its timer, progress and status."""
    assert operator.reports == [("WARNING", "Cancelled. Nothing was changed.")]
    assert context.status is None
    assert context.window_manager.timers == []
    assert context.window_manager.progress[-1] == "end"


@pytest.mark.parametrize("name", ["retarget_weights", "bind_weights", "check"])
def test_escape_ends_at_once_while_the_work_goes_on(name, stuck, scene):
    operator, context = stand_in_for(name), Context()
    operator.use_retarget = True
    if name == "bind_weights":
        c.activate(bpy.data.objects["SourceRig"], scene)
    before = c.state(scene)
    assert operator.invoke(context, None) == {"RUNNING_MODAL"}
    assert stuck.entered.acquire(timeout=30)
    assert operator.modal(context, event("ESC", "PRESS")) == {"CANCELLED"}
    assert_left(operator, context)
    assert working_threads(), "the native call is still in its step"
    assert c.state(scene) == before
    stuck.opened.set()
    end_all()
    assert not working_threads()
    assert not stuck.results
    assert c.state(scene) == before
    assert kept_report(scene) is None


def test_abandoned_work_does_not_hold_up_the_next(operator, stuck, scene):
    first = Context()
    operator.invoke(first, None)
    assert stuck.entered.acquire(timeout=30)
    operator.modal(first, event("ESC", "PRESS"))
    abandoned = working_threads()
    again, second = stand_in_for("retarget_weights"), Context()
    assert again.invoke(second, None) == {"RUNNING_MODAL"}
    assert stuck.entered.acquire(timeout=30), "the new work begins beside the abandoned one"
    assert set(abandoned) < set(working_threads())
    stuck.opened.set()
    assert until_ended(again, second) == {"FINISHED"}
    written = c.state(scene)
    end_all()
    assert c.state(scene) == written
    assert operator.reports == [("WARNING", "Cancelled. Nothing was changed.")]


@pytest.mark.usefixtures("scene")
def test_the_extension_waits_for_abandoned_work_when_it_goes(operator, stuck):
    context = Context()
    operator.invoke(context, None)
    assert stuck.entered.acquire(timeout=30)
    operator.modal(context, event("ESC", "PRESS"))
    opener = threading.Timer(0.3, stuck.opened.set)
    opener.start()
    try:
        bpy.ops.preferences.addon_disable(module=MODULE)
        assert not working_threads()
    finally:
        bpy.ops.preferences.addon_enable(module=MODULE)


def test_escape_leaves_a_process_that_ends(addon):
    """A process with work of a real size, cancelled in its midst, ends by itself and in order."""
    del addon
    script = Path(__file__).with_name("cancelled_process.py")
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["running", "abandoned", "ended"]


@pytest.mark.usefixtures("gate", "scene")
def test_blender_ends_the_operator(operator):
    context = Context()
    operator.invoke(context, None)
    task = operator._running.task
    operator.cancel(context)
    assert task.wait(5)
    assert context.window_manager.timers == []


def test_target_removed_meanwhile(operator, gate, scene):
    context = Context()
    operator.invoke(context, None)
    bpy.data.objects.remove(scene)
    gate.set()
    assert until_ended(operator, context) == {"CANCELLED"}
    assert operator.reports == [
        ("ERROR", "A mesh was removed while its weights were being retargeted. Nothing was changed.")
    ]


def test_target_edited_meanwhile(operator, gate, scene):
    context = Context()
    operator.invoke(context, None)
    scene.data.vertices.add(1)
    before = c.state(scene)
    gate.set()
    assert until_ended(operator, context) == {"CANCELLED"}
    assert operator.reports == [
        ("ERROR", "'Target' was edited while its weights were being retargeted. Nothing was changed.")
    ]
    assert c.state(scene) == before


@pytest.mark.usefixtures("gate", "scene")
def test_bad_input_ends_at_once(operator):
    context = Context()
    bpy.data.objects["Source"].vertex_groups.clear()
    assert operator.invoke(context, None) == {"CANCELLED"}
    assert operator.reports[0][0] == "ERROR"
    assert context.window_manager.timers == []


@pytest.fixture
def dry_run():
    operator = stand_in_for("check")
    operator.use_retarget = True
    return operator


def kept_report(ob):
    return sys.modules[f"{MODULE}.blender.check_reports"].kept_report(ob)


def test_dry_run_reports_at_its_end(dry_run, gate, scene):
    context = Context()
    before = c.state(scene)
    assert dry_run.invoke(context, None) == {"RUNNING_MODAL"}
    assert dry_run.modal(context, event("TIMER")) == {"RUNNING_MODAL"}
    assert context.status.startswith("Checking: ")
    gate.set()
    assert until_ended(dry_run, context) == {"FINISHED"}
    assert c.state(scene) == before
    assert kept_report(scene) is not None
    assert context.window_manager.timers == []


@pytest.mark.usefixtures("gate")
def test_escape_ends_a_dry_run(dry_run, scene):
    context = Context()
    before = c.state(scene)
    dry_run.invoke(context, None)
    assert dry_run.modal(context, event("ESC", "PRESS")) == {"CANCELLED"}
    assert dry_run.reports == [("WARNING", "Cancelled. Nothing was changed.")]
    assert c.state(scene) == before
    assert kept_report(scene) is None


def test_mesh_removed_while_it_is_checked(dry_run, gate, scene):
    context = Context()
    dry_run.invoke(context, None)
    bpy.data.objects.remove(scene)
    gate.set()
    assert until_ended(dry_run, context) == {"CANCELLED"}
    assert dry_run.reports == [("ERROR", "A mesh was removed while it was being checked. Nothing was changed.")]
