# SPDX-License-Identifier: GPL-3.0-or-later
"""The fit in a window: progress, ESC, and the preview that asks before anything is changed."""

import sys
import threading

import bpy
import characters as c
import fits
import numpy as np
import pytest
from scratch_profile import MODULE
from windows import Context, event, held, in_window, stand_in_for, until_ended


@pytest.fixture
def body():
    return fits.bare_body()


@pytest.fixture
def gate(monkeypatch):
    """A fit that waits until it is let through or cancelled."""
    in_window(monkeypatch)
    yield from held(monkeypatch, "fit", "fit_skeleton")
    assert overlays() == []


def overlays():
    return sys.modules[f"{MODULE}.blender.bone_overlay"]._shown


@pytest.fixture
def started(body, gate):
    """The operator in a window, working; its context; the armature and how it was."""
    operator, context = stand_in_for("fit_skeleton"), Context()
    rig = fits.template()
    c.activate(rig, body)
    bpy.context.view_layer.update()
    before = fits.everything()
    assert operator.invoke(context, None) == {"RUNNING_MODAL"}
    assert not gate.is_set()
    return operator, context, rig, before


def previewed(operator, context, gate):
    gate.set()
    operator._running.task.wait(60)
    assert operator.modal(context, event("TIMER")) == {"RUNNING_MODAL"}
    assert len(overlays()) == 1
    assert "Enter: apply, ESC: cancel" in context.status
    assert "score" in context.status
    assert context.window_manager.timers == []


def test_escape_while_it_works(started):
    operator, context, _, before = started
    assert operator.modal(context, event("TIMER")) == {"RUNNING_MODAL"}
    assert context.status.startswith("Fitting: ")
    status = operator.modal(context, event("ESC", "PRESS"))
    assert (until_ended(operator, context) if status == {"RUNNING_MODAL"} else status) == {"CANCELLED"}
    assert operator.reports == [("WARNING", "Cancelled. Nothing was changed.")]
    assert fits.everything() == before
    assert context.status is None


@pytest.mark.parametrize("key", ["RET", "NUMPAD_ENTER"])
def test_enter_applies_the_preview(started, gate, key):
    operator, context, rig, before = started
    previewed(operator, context, gate)
    assert fits.everything() == before
    assert operator.modal(context, event("MIDDLEMOUSE", "PRESS")) == {"PASS_THROUGH"}
    assert operator.modal(context, event("X", "PRESS")) == {"RUNNING_MODAL"}
    assert operator.modal(context, event(key, "RELEASE")) == {"RUNNING_MODAL"}
    wanted = operator._running.fitted().heads
    assert operator.modal(context, event(key, "PRESS")) == {"FINISHED"}
    assert overlays() == []
    assert context.status is None
    assert [kind for kind, _ in operator.reports] in (["INFO"], ["WARNING"])
    np.testing.assert_allclose([points[0] for points in fits.joints(rig).values()], wanted, atol=1e-5)


@pytest.mark.parametrize("key", ["ESC", "RIGHTMOUSE"])
def test_the_preview_is_refused(started, gate, key):
    operator, context, _, before = started
    previewed(operator, context, gate)
    assert operator.modal(context, event(key, "PRESS")) == {"CANCELLED"}
    assert operator.reports == [("WARNING", "Cancelled. Nothing was changed.")]
    assert overlays() == []
    assert context.status is None
    assert fits.everything() == before


def test_blender_ends_the_preview(started, gate):
    operator, context, _, before = started
    previewed(operator, context, gate)
    operator.cancel(context)
    assert overlays() == []
    assert fits.everything() == before


def test_blender_ends_the_work(started):
    operator, context, _, _ = started
    operator.cancel(context)
    assert operator._running.task.wait(5)
    assert context.window_manager.timers == []


def test_a_short_job_shows_its_preview_too(body, gate, monkeypatch):
    monkeypatch.setattr(sys.modules[f"{MODULE}.ui.modal_job"], "PATIENCE_SECONDS", 60.0)
    gate.set()
    operator, context = stand_in_for("fit_skeleton"), Context()
    c.activate(fits.template(), body)
    assert operator.invoke(context, None) == {"RUNNING_MODAL"}
    assert context.window_manager.handlers == [operator]
    assert len(overlays()) == 1
    assert operator.modal(context, event("RET", "PRESS")) == {"FINISHED"}


def test_without_a_preview(started, gate):
    operator, context, rig, _ = started
    operator.preview = False
    before = fits.rest(rig)
    gate.set()
    assert until_ended(operator, context) == {"FINISHED"}
    assert fits.rest(rig) != before


def test_the_armature_changes_meanwhile(started, gate):
    operator, context, rig, _ = started
    previewed(operator, context, gate)
    with fits.in_edit_mode(rig) as edit:
        edit["head"].tail.z += 0.1
    before = fits.everything()
    assert operator.modal(context, event("RET", "PRESS")) == {"CANCELLED"}
    assert operator.reports == [("ERROR", "'Rig' was edited while it was being fitted. Nothing was changed.")]
    assert fits.everything() == before
    assert overlays() == []


def test_the_armature_goes_meanwhile(started, gate):
    operator, context, rig, _ = started
    previewed(operator, context, gate)
    bpy.data.objects.remove(rig)
    assert operator.modal(context, event("RET", "PRESS")) == {"CANCELLED"}
    assert operator.reports == [("ERROR", "The armature was removed while it was being fitted. Nothing was changed.")]


def test_unregistering_ends_the_drawing(started, gate):
    operator, context, _, _ = started
    previewed(operator, context, gate)
    sys.modules[f"{MODULE}.blender.bone_overlay"].remove_overlays()
    assert overlays() == []
    assert operator.modal(context, event("ESC", "PRESS")) == {"CANCELLED"}


def test_progress_without_a_window(body, gate, monkeypatch, capsys):
    monkeypatch.setattr(sys.modules[f"{MODULE}.ui.modal_job"], "bpy", bpy)
    monkeypatch.setattr(sys.modules[f"{MODULE}.core.fit"].FitTask, "stage", "searching")
    threading.Timer(0.3, gate.set).start()
    fits.fit(fits.template(), body)
    assert "Fitting: searching (0%)" in capsys.readouterr().out
