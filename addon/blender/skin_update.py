# SPDX-License-Identifier: GPL-3.0-or-later
"""One object in one frame: read the pose, solve where something moved, write the shape key.

The shape key is a function of the evaluated scene alone; what was shown before never matters.
Whatever goes wrong becomes one line and the plain skin.
"""

import logging
from time import perf_counter

import bpy
import numpy as np

from ..core.errors import InputError, sentence
from ..core.pose import conjugated
from ..core.skin_input import check_finite_pose
from ..core.skin_settings import SkinSettings
from . import placement
from .bone_layout import armature_digest
from .shape_mix import key_groups, mixed_positions
from .skin_checks import check_owner, check_shape_keys, skin_modifier
from .skin_key import KEY_NAME, find_key, write_offsets
from .skin_reading import read_settings, read_skin, shape_digest
from .skin_state import SkinState, registry

log = logging.getLogger(__name__)

# In these modes Blender keeps the vertices elsewhere or is changing them.
EDITING = {"EDIT", "SCULPT"}
PLAIN = b"plain"

REBUILT = "The mesh, its weights or the rest pose changed: the skin was rebuilt."
PAUSED = "The plain skin is shown while weights are painted."


def update_skin(ob: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> None:
    """Bring the object's shape key up to date with an evaluated scene. Never raises."""
    state = registry.state(ob)
    if ob.mode in EDITING:
        state.suspect = True
        return
    evaluated = ob.evaluated_get(depsgraph)
    if not evaluated.is_evaluated:
        return
    began = perf_counter()
    try:
        solved = _update(ob, evaluated, state, depsgraph)
        state.error = ""
    except InputError as error:
        _fail(ob, state, str(error))
    except Exception as error:
        log.exception("the skin of '%s' failed", ob.name)
        _fail(ob, state, f"Unexpected {type(error).__name__}: {sentence(str(error))}")
    else:
        if solved:
            state.milliseconds = 1000.0 * (perf_counter() - began)


def _fail(ob: bpy.types.Object, state: SkinState, message: str) -> None:
    if message != state.error:
        log.warning("'%s': %s", ob.name, message)
    state.error = message
    try:
        _show_plain(ob, state)
    except Exception:
        log.exception("the plain skin of '%s' cannot be shown", ob.name)


def _show_plain(ob: bpy.types.Object, state: SkinState) -> None:
    key = find_key(ob)
    if key is None or state.written == PLAIN:
        return
    if ob.data.library is None:
        write_offsets(ob, None)
    else:
        # The points of linked keys cannot be written, but this can.
        key.mute = True
    state.written = PLAIN


def _update(
    ob: bpy.types.Object, evaluated: bpy.types.Object, state: SkinState, depsgraph: bpy.types.Depsgraph
) -> bool:
    """True where the shape key was solved anew."""
    check_owner(ob)
    if find_key(ob) is None:
        raise InputError(f"The shape key '{KEY_NAME}' of '{ob.name}' is gone: enable the PBD skin again.")
    check_shape_keys(ob)
    modifier = skin_modifier(ob)
    if ob.mode == "WEIGHT_PAINT":
        state.notice, state.suspect = PAUSED, True
        _show_plain(ob, state)
        return False
    if state.notice == PAUSED:
        state.notice = ""
    rendering = depsgraph.mode == "RENDER"
    if not (modifier.show_render if rendering else modifier.show_viewport):
        _show_plain(ob, state)
        return False
    armature = modifier.object.evaluated_get(depsgraph)
    _refresh(ob, state, modifier, depsgraph)
    vertices, value = mixed_positions(ob, depsgraph, state.reading.key_groups)
    if value == 0.0:
        return False
    deltas = state.reading.layout.deltas(armature)
    if deltas is None:
        state.suspect = True
        _refresh(ob, state, modifier, depsgraph)
        deltas = state.reading.layout.deltas(armature)
    check_finite_pose(armature.name, state.reading.layout.bones, deltas)
    place = state.place
    state.placed = placement.placed_armature(place, evaluated, armature, state.placed)
    transforms = conjugated(deltas, state.placed.matrix).astype(np.float32)
    if vertices is not None:
        vertices = (vertices @ place.object[:3, :3].T).astype(np.float32)
    signature = state.skin_key.encode() + transforms.tobytes() + (b"" if vertices is None else vertices.tobytes())
    if signature == state.written:
        return False
    correction = state.skin.correction(transforms, vertices, state.reading.shares)
    write_offsets(ob, place.in_object(correction.offsets))
    state.written = signature
    state.limited, state.stats = correction.limited, correction.stats
    return True


def _refresh(
    ob: bpy.types.Object, state: SkinState, modifier: bpy.types.ArmatureModifier, depsgraph: bpy.types.Depsgraph
) -> None:
    """Read the mesh again and take another skin where something that matters has changed."""
    settings = read_settings(ob)
    configuration = (
        (settings, ob.dermis_skin.stiffness_group),
        modifier.object.name,
        modifier.use_deform_preserve_volume,
        modifier.vertex_group,
        modifier.invert_vertex_group,
        len(ob.data.vertices),
        len(ob.data.loops),
        len(ob.vertex_groups),
        key_groups(ob.data),
    )
    held = (
        state.is_held and not state.failure and state.skin is not None and configuration[1:] == state.configuration[1:]
    )
    if held and depsgraph.mode != "RENDER":
        # The edit of a setting makes the mesh look edited too; all of it is looked at afterwards.
        return
    suspect = state.suspect
    if state.check_shape and not suspect:
        suspect = shape_digest(ob.data) != state.shape
    if state.check_armature and not suspect:
        suspect = armature_digest(modifier.object.data) != state.armature
    state.check_shape = state.check_armature = False
    if not suspect and configuration == state.configuration:
        if state.failure:
            raise InputError(state.failure)
        return
    state.suspect = False
    state.configuration = configuration
    state.shape, state.armature = shape_digest(ob.data), armature_digest(modifier.object.data)
    state.failure = "The skin could not be built; the console has details."
    try:
        _rebuild(ob, state, modifier, settings, depsgraph)
    except InputError as error:
        state.failure = str(error)
        raise
    state.failure = ""


def _rebuild(
    ob: bpy.types.Object,
    state: SkinState,
    modifier: bpy.types.ArmatureModifier,
    settings: SkinSettings,
    depsgraph: bpy.types.Depsgraph,
) -> None:
    place = placement.stored(ob)
    reading = read_skin(ob, modifier, settings, depsgraph, place)
    if reading.geometry_key != ob.dermis_skin.geometry_key:
        place = placement.place(ob.evaluated_get(depsgraph), modifier.object.evaluated_get(depsgraph))
        reading = read_skin(ob, modifier, settings, depsgraph, place)
        placement.store(ob, place, reading.geometry_key)
        state.notice = REBUILT
    key = reading.skin_key(place)
    state.skin = registry.skin(reading, key, place)
    state.reading, state.place, state.placed, state.skin_key = reading, place, None, key
    state.stats = state.skin.stats
    state.written = None
