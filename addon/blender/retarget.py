# SPDX-License-Identifier: GPL-3.0-or-later
"""Characters from mesh objects, and the results back onto them."""

from collections.abc import Sequence
from dataclasses import dataclass

import bpy
import numpy as np

from ..core.character import BonePair, Source, Target
from ..core.errors import InputError, listed
from ..core.retarget import TargetWeights
from .armature import attach_armature, check_attachable, find_armature, is_deformed, is_posed, read_bones
from .match_display import show_status, shows_status
from .mesh import read_surface
from .scope import Scope
from .target_checks import check_writable
from .transaction import restored_on_failure
from .vertex_groups import read_groups, write_groups


@dataclass(frozen=True)
class TargetChoice:
    """What the user chose for one target: pairs of source vertex and target vertex, and of source bone and target bone.

    Without landmarks they are found on the skeletons; bone_map None has the bones mapped too.
    """

    landmarks: Sequence[tuple[int, int]] = ()
    bone_map: tuple[BonePair, ...] | None = None


def source_armature(ob: bpy.types.Object) -> bpy.types.Object:
    """The armature of the source; InputError when it has none."""
    armature = find_armature(ob)
    if armature is None:
        raise InputError(f"The source '{ob.name}' has no armature.")
    return armature


def read_source(ob: bpy.types.Object, depsgraph: bpy.types.Depsgraph, evaluated: bool) -> Source:
    """The character that gives its weights."""
    armature = source_armature(ob)
    if not ob.vertex_groups:
        raise InputError(f"The source '{ob.name}' has no vertex groups.")
    bones = read_bones(armature, depsgraph if evaluated else None)
    groups = read_groups(ob)
    boneless = tuple(name for name in groups.names if name not in set(bones.names))
    if len(boneless) == len(groups.names):
        raise InputError(
            f"No vertex group of '{ob.name}' ({listed(boneless)}) has the name of a deforming bone of "
            f"'{armature.name}'."
        )
    return Source(
        name=ob.name,
        armature=armature.name,
        surface=read_surface(ob, depsgraph, evaluated),
        bones=bones,
        weights=groups.of_bones(bones.names),
        boneless_groups=boneless,
        boneless=groups.of_bones(boneless),
        shape="evaluated" if evaluated else "pose ignored" if is_posed(armature, depsgraph) else "rest",
    )


def read_target(
    ob: bpy.types.Object,
    source: bpy.types.Object,
    depsgraph: bpy.types.Depsgraph,
    evaluated: bool,
    choice: TargetChoice,
    scope: Scope,
    boneless_groups: tuple[str, ...],
) -> Target:
    """The character that gets weights, with its own armature or, where it has none, the source's."""
    check_writable(ob)
    own = find_armature(ob)
    armature = own or source_armature(source)
    check_attachable(ob, armature)
    bones = read_bones(armature, depsgraph if evaluated and own is not None and is_deformed(ob) else None)
    groups = read_groups(ob)
    copied = scope.boneless_groups(boneless_groups, groups, bones.names)
    return Target(
        name=ob.name,
        armature=armature.name,
        surface=read_surface(ob, depsgraph, evaluated),
        bones=bones,
        existing=groups.of_bones(bones.names),
        locked=groups.locked_bones(bones.names),
        landmarks=np.array(choice.landmarks, np.int64).reshape(-1, 2) if choice.landmarks else None,
        only_bones=scope.bones(ob, armature, groups, bones.names),
        only_vertices=scope.vertices(ob, groups),
        part_vertices=scope.part_vertices(ob),
        copied_groups=copied,
        copied_existing=groups.of_bones(copied),
        bone_map=choice.bone_map,
    )


def write_targets(
    source: bpy.types.Object,
    objects: Sequence[bpy.types.Object],
    targets: Sequence[Target],
    results: Sequence[TargetWeights],
    show_match: bool = False,
) -> None:
    """Write all results, or none: an exception leaves every object as it was."""
    for ob, target in zip(objects, targets, strict=True):
        check_writable(ob)
        if len(ob.data.vertices) != len(target.surface.vertices):
            raise InputError(f"'{ob.name}' was edited while its weights were being retargeted.")
    with restored_on_failure(objects):
        for ob, target, result in zip(objects, targets, results, strict=True):
            write_groups(ob, target.bones.names, result.weights, result.replaced, result.groups, result.written)
            write_groups(ob, target.copied_groups, result.copied, result.replaced, range(len(target.copied_groups)))
            attach_armature(ob, find_armature(ob) or source_armature(source))
            if show_match or shows_status(ob.data):
                show_status(ob.data, result.status)
