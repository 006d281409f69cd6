# SPDX-License-Identifier: GPL-3.0-or-later
"""The Mesh Cache modifier that plays a baked skin, with Dermis or without it."""

import bpy

from ..core.frame_range import FrameRange
from ..core.point_cache import CacheFormat

MODIFIER_NAME = "Dermis Cache"


def find_cache(ob: bpy.types.Object) -> bpy.types.MeshCacheModifier | None:
    """The modifier, where the object has it."""
    modifier = ob.modifiers.get(MODIFIER_NAME)
    return modifier if modifier is not None and modifier.type == "MESH_CACHE" else None


def add_cache(
    ob: bpy.types.Object,
    after: bpy.types.Modifier,
    filepath: str,
    kind: CacheFormat,
    frames: FrameRange,
    scene: bpy.types.Scene,
) -> bpy.types.MeshCacheModifier:
    """Play a file in the place of what `after` shows; all modifiers behind stay live."""
    active = ob.modifiers.active
    modifier = ob.modifiers.new(MODIFIER_NAME, "MESH_CACHE")
    place = next(i for i, m in enumerate(ob.modifiers) if m == after) + 1
    # Not always from the end: pinned modifiers stay last.
    ob.modifiers.move(ob.modifiers.find(modifier.name), place)
    if active is not None:
        ob.modifiers.active = active
    modifier.cache_format = kind
    modifier.filepath = filepath
    modifier.deform_mode = "OVERWRITE"
    modifier.interpolation = "LINEAR"
    modifier.forward_axis, modifier.up_axis = "POS_Y", "POS_Z"
    modifier.factor = 1.0
    # Sample = scale · time - start, with the scene's time after its own stretching.
    modifier.play_mode, modifier.time_mode = "SCENE", "FRAME"
    stretch = scene.render.frame_map_old / scene.render.frame_map_new
    modifier.frame_scale = frames.per_frame / stretch
    modifier.frame_start = frames.per_frame * frames.start
    modifier.show_viewport, modifier.show_render = after.show_viewport, after.show_render
    return modifier
