# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators in a window that a Blender without one has not: stand-ins for the window and for the operator."""

import sys
import threading
from types import SimpleNamespace

import bpy
from scratch_profile import MODULE


class Manager:
    """Stands in for the window manager of a window, which a module has not."""

    def __init__(self):
        self.timers, self.handlers, self.progress = [], [], []

    def event_timer_add(self, _seconds, window):
        self.timers.append(window)
        return window

    def event_timer_remove(self, timer):
        self.timers.remove(timer)

    def modal_handler_add(self, operator):
        self.handlers.append(operator)

    def progress_begin(self, *_):
        self.progress.append("begin")

    def progress_update(self, value):
        self.progress.append(value)

    def progress_end(self):
        self.progress.append("end")


class Context:
    """The real context with a window."""

    def __init__(self):
        self.window, self.window_manager, self.status = "window", Manager(), "unset"
        self.workspace = SimpleNamespace(status_text_set=lambda text: setattr(self, "status", text))

    def __getattr__(self, name):
        return getattr(bpy.context, name)


def stand_in_for(name):
    """An operator's Python half, with the default of each option."""
    original = getattr(bpy.types, f"DERMIS_OT_{name}")
    properties = getattr(bpy.ops.dermis, name).get_rna_type().properties
    values = {p.identifier: p.default for p in properties if p.identifier != "rna_type"}
    methods = {}
    for base in reversed([base for base in original.__mro__ if base.__module__.startswith(MODULE)]):
        methods |= {name: value for name, value in vars(base).items() if callable(value)}
    stand_in = type("StandIn", (), {**methods, "bl_idname": original.bl_idname, "doing": original.doing})()
    vars(stand_in).update(values, reports=[])
    stand_in.report = lambda kind, text: stand_in.reports.append((*kind, text))
    return stand_in


def event(kind, value="NOTHING"):
    return SimpleNamespace(type=kind, value=value)


def until_ended(operator, context):
    """Timer events until the operator has ended; its status."""
    for _ in range(2000):
        status = operator.modal(context, event("TIMER"))
        if status != {"RUNNING_MODAL"}:
            return status
        operator._running.task.wait(0.01)
    raise AssertionError("the modal operator does not end")


def in_window(monkeypatch, *more):
    """Let the modal operators, and modules of `ui` named besides, believe that there is a window."""
    for name in ("modal_job", *more):
        module = sys.modules[f"{MODULE}.ui.{name}"]
        monkeypatch.setattr(module, "bpy", SimpleNamespace(app=SimpleNamespace(background=False), context=bpy.context))
    monkeypatch.setattr(sys.modules[f"{MODULE}.ui.modal_job"], "PATIENCE_SECONDS", 0.0)


def held(monkeypatch, module, function):
    """Body of a fixture: `function` of a module of `core` waits until the event is set or it is cancelled."""
    module = sys.modules[f"{MODULE}.core.{module}"]
    original, opened = getattr(module, function), threading.Event()

    def waiting(*arguments, **options):
        progress = options.get("progress", arguments[-1] if arguments else None)
        while not opened.wait(0.005):
            if progress.cancelled:
                raise module.Cancelled("cancelled")
        return original(*arguments, **options)

    monkeypatch.setattr(module, function, waiting)
    monkeypatch.setattr(sys.modules[f"{MODULE}.ui.modal_job"], "PATIENCE_SECONDS", 0.0)
    yield opened
    opened.set()
