# SPDX-License-Identifier: GPL-3.0-or-later
"""One bind from the scene and back into it: read, work in a thread, write."""

from collections.abc import Sequence
from time import perf_counter

import bpy

from ..core.bind import BindSettings, BindTask, bind_line, bind_notes
from ..core.character import Target
from ..core.errors import InputError
from .armature import attach_armature, check_attachable, find_armature, is_deformed, read_bones
from .mesh import read_surface
from .scope import Scope
from .target_checks import check_writable
from .transaction import restored_on_failure
from .vertex_groups import read_groups, write_groups


class BindJob:
    """Reads everything and checks it in the constructor; `finish` writes all meshes, or none."""

    def __init__(
        self,
        armature: bpy.types.Object,
        objects: Sequence[bpy.types.Object],
        evaluated: bool,
        settings: BindSettings,
        depsgraph: bpy.types.Depsgraph,
        scope: Scope,
    ) -> None:
        self._began = perf_counter()
        self._armature = armature
        self.objects = tuple(objects)
        scope.check(objects)
        self._targets = [read_bind_target(ob, armature, depsgraph, evaluated, scope) for ob in objects]
        self.task = BindTask(self._targets, settings)

    def finish(self) -> tuple[str, list[str]]:
        """Write the results; the line to report and notes on what was left out."""
        results = self.task.result()
        try:
            for ob, target in zip(self.objects, self._targets, strict=True):
                check_free(ob, self._armature)
                if len(ob.data.vertices) != len(target.surface.vertices):
                    raise InputError(f"'{ob.name}' was edited while it was being bound.")
            with restored_on_failure(self.objects):
                for ob, target, result in zip(self.objects, self._targets, results, strict=True):
                    write_groups(ob, target.bones.names, result.weights, result.replaced, result.groups, result.written)
                    attach_armature(ob, self._armature)
        except ReferenceError as error:
            raise InputError("A mesh or the armature was removed while the meshes were being bound.") from error
        return bind_line(self._targets, results, perf_counter() - self._began), bind_notes(self._targets, results)


def read_bind_target(
    ob: bpy.types.Object,
    armature: bpy.types.Object,
    depsgraph: bpy.types.Depsgraph,
    evaluated: bool,
    scope: Scope,
) -> Target:
    """A mesh to bind to an armature; InputError where it cannot be."""
    check_free(ob, armature)
    bones = read_bones(armature, depsgraph if evaluated else None)
    bones.check(armature.name)
    groups = read_groups(ob)
    return Target(
        name=ob.name,
        armature=armature.name,
        surface=read_surface(ob, depsgraph, evaluated),
        bones=bones,
        existing=groups.of_bones(bones.names),
        locked=groups.locked_bones(bones.names),
        only_bones=scope.bones(ob, armature, groups, bones.names),
        only_vertices=scope.vertices(ob, groups),
        part_vertices=scope.part_vertices(ob),
    )


def check_free(ob: bpy.types.Object, armature: bpy.types.Object) -> None:
    """Raise InputError when the object cannot be written to, or follows another armature."""
    check_writable(ob)
    own = find_armature(ob)
    if is_deformed(ob) and own != armature:
        raise InputError(
            f"'{ob.name}' follows the armature '{own.name}', not '{armature.name}': "
            "remove its Armature modifier or clear its parent first."
        )
    check_attachable(ob, armature)
