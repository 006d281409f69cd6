# SPDX-License-Identifier: GPL-3.0-or-later
"""Point caches of parts of a range: joined into one file and played."""

from collections.abc import Sequence
from pathlib import Path

import bpy

from ..core.errors import InputError, counted
from ..core.frame_range import FrameRange
from ..core.new_files import NewFiles
from ..core.point_cache import CacheLayout, join_caches, read_layout
from .bake_source import BakeSource
from .bake_state import switch_off
from .cache_job import cache_paths, check_own
from .mesh_cache import add_cache
from .skin_state import registry


def join_parts(ob: bpy.types.Object, scene: bpy.types.Scene, parts: Sequence[Path], folder: str) -> str:
    """Join the parts and play them on the object; one line about it. InputError leaves everything as it was."""
    check_own(ob)
    source = BakeSource(ob, bpy.context.evaluated_depsgraph_get())
    try:
        first = read_layout(parts[0])
        if first.vertex_count != len(ob.data.vertices):
            raise InputError(
                f"'{parts[0].name}' has {first.vertex_count} vertices and '{ob.name}' has {len(ob.data.vertices)}."
            )
        (filepath,) = cache_paths([ob], folder, first.format)
        with NewFiles() as files:
            beside = files.add(Path(bpy.path.abspath(filepath)), sum(path.stat().st_size for path in parts))
            layout = join_caches(parts, beside)
            frames = _frames(layout, scene)
            files.commit()
    except OSError as error:
        raise InputError(f"'{error.filename}': {error.strerror or error}.") from error
    add_cache(ob, source.modifier, filepath, layout.format, frames, scene)
    if source.is_live:
        switch_off(ob, "CACHE")
    registry.forget(ob)
    return f"Joined {counted(len(parts), 'part')} of '{ob.name}': {counted(len(frames), 'sample')}."


def _frames(layout: CacheLayout, scene: bpy.types.Scene) -> FrameRange:
    """The frames of a cache's samples."""
    rate = scene.render.fps / scene.render.fps_base if layout.format == "MDD" else 1.0
    start = float(layout.times[0]) * rate
    per_frame = 1 if layout.step == 0 else round(1.0 / (layout.step * rate))
    ends = start + (len(layout.times) - 1) / max(per_frame, 1)
    if per_frame < 1 or abs(start - round(start)) > 1e-3 or abs(ends - round(ends)) > 1e-3:
        raise InputError("The parts do not start and end at whole frames of this scene.")
    return FrameRange(round(start), round(ends), per_frame)
