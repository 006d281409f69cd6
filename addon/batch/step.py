# SPDX-License-Identifier: GPL-3.0-or-later
"""One step: an operator with the objects that it works on in the place of the selection."""

import time
from typing import Any

import bpy

from ..blender.check_reports import kept_report
from ..blender.skin_switch import meshes_of
from ..core.check import CATEGORIES
from ..core.errors import InputError, listed
from ..core.recipe import Step
from .reports import heard

DONE, FAILED, PROBLEMS = "done", "failed", "problems"


def run_step(step: Step) -> dict[str, Any]:
    """Call the operator; what it reported, how long it took, and counts of the meshes."""
    start = time.monotonic()
    entry: dict[str, Any] = {
        "command": step.command.name,
        "objects": {role: list(names) for role, names in step.objects.items()},
        "options": step.options,
        "status": FAILED,
    }
    with heard() as reports:
        try:
            objects = [_object(name) for names in step.objects.values() for name in names]
            _call(step, objects)
            entry["status"] = DONE
            entry["counts"] = [_counts(ob) for ob in _meshes(objects)]
            if step.command.operator == "check":
                entry["checks"] = _checks(objects)
                if any(check["to_look_at"] for check in entry["checks"]):
                    entry["status"] = PROBLEMS
        except (InputError, RuntimeError) as error:
            # What an operator reported as an error comes again as the exception.
            if not any(report["level"] == "ERROR" for report in reports):
                reports.append({"level": "ERROR", "text": str(error).removeprefix("Error: ").strip()})
    entry["reports"] = list(reports)
    entry["seconds"] = round(time.monotonic() - start, 3)
    return entry


def _call(step: Step, objects: list[bpy.types.Object]) -> None:
    options = dict(step.options)
    if step.command.settings:
        _set_skin(objects, options)
        options = {}
    if step.command.parts:
        options.update(directory="", files=[{"name": path} for path in step.parts])
    operator = getattr(bpy.ops.dermis, step.command.operator)
    chosen = {"active_object": objects[0], "object": objects[0], "selected_objects": objects}
    layer = bpy.context.view_layer
    active = layer.objects.active
    # Edit Mode, which bones need, asks for the active object itself; the selection stays the file's.
    layer.objects.active = objects[0]
    try:
        with bpy.context.temp_override(**chosen):
            if operator("EXEC_DEFAULT", **options) != {"FINISHED"}:
                raise InputError("It was cancelled.")
    finally:
        layer.objects.active = active


def _set_skin(objects: list[bpy.types.Object], settings: dict[str, Any]) -> None:
    """Settings of the skin on the meshes; the preset first, which fills the others."""
    for ob in _meshes(objects):
        for name in sorted(settings, key=lambda name: name != "preset"):
            setattr(ob.dermis_skin, name, settings[name])


def _object(name: str) -> bpy.types.Object:
    """The object of the view layer; a mesh must be visible, as its shown shape may be asked for."""
    ob = bpy.context.view_layer.objects.get(name)
    if ob is None:
        where = "is not in the view layer" if name in bpy.data.objects else "is not in the file"
        meshes = [ob.name for ob in bpy.context.view_layer.objects if ob.type in ("MESH", "ARMATURE")]
        raise InputError(f"'{name}' {where}; there are {listed(meshes)}.")
    if ob.type == "MESH" and not ob.visible_get():
        raise InputError(f"'{name}' is hidden: show it.")
    return ob


def _meshes(objects: list[bpy.types.Object]) -> list[bpy.types.Object]:
    """The meshes among the objects; where there is none, those of the active armature."""
    meshes = [ob for ob in objects if ob.type == "MESH"]
    if not meshes and objects[0].type == "ARMATURE":
        return meshes_of(objects[0], bpy.context.scene)
    return meshes


def _counts(ob: bpy.types.Object) -> dict[str, Any]:
    return {"name": ob.name, "vertices": len(ob.data.vertices), "vertex_groups": len(ob.vertex_groups)}


def _checks(objects: list[bpy.types.Object]) -> list[dict[str, Any]]:
    """What the check found, by mesh and by category."""
    found = []
    for ob in objects:
        report = kept_report(ob)
        if report is not None:
            counts = {name: len(report.vertices[name]) for name in CATEGORIES if name in report.vertices}
            found.append({"mesh": ob.name, "to_look_at": report.faults, "categories": counts, "lines": report.lines()})
    return found
