# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws bones over everything in the 3D viewports, until it is told to stop."""

from collections.abc import Iterator

import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

# Colors of bones that the body's shape placed, that were carried along, and that stayed.
PLACED = (0.25, 0.75, 1.0, 1.0)
CARRIED = (1.0, 0.62, 0.2, 1.0)
KEPT = (0.75, 0.75, 0.75, 1.0)
OUTLINE = (0.0, 0.0, 0.0, 0.6)
LINE_WIDTH = 3.0
POINT_SIZE = 8.0

_shown: list["BoneOverlay"] = []


class BoneOverlay:
    """Bones as lines with points at their joints; it keeps arrays, never Blender's objects."""

    def __init__(self, heads: np.ndarray, tails: np.ndarray, colors: np.ndarray) -> None:
        self._heads, self._tails = heads.astype(np.float32), tails.astype(np.float32)
        self._colors = colors.astype(np.float32)
        self._handle = bpy.types.SpaceView3D.draw_handler_add(self._draw, (), "WINDOW", "POST_VIEW")
        _shown.append(self)
        redraw()

    def remove(self) -> None:
        """Stop drawing; may be called again."""
        if self in _shown:
            _shown.remove(self)
            bpy.types.SpaceView3D.draw_handler_remove(self._handle, "WINDOW")
            redraw()

    def _draw(self) -> None:
        depth, blend = gpu.state.depth_test_get(), gpu.state.blend_get()
        gpu.state.depth_test_set("NONE")
        gpu.state.blend_set("ALPHA")
        try:
            ends = np.stack([self._heads, self._tails], axis=1).reshape(-1, 3)
            _draw_lines(ends, np.full((len(ends), 4), OUTLINE, np.float32), LINE_WIDTH + 2.0)
            _draw_lines(ends, np.repeat(self._colors, 2, axis=0), LINE_WIDTH)
            _draw_points(ends, np.full((len(ends), 4), OUTLINE, np.float32), POINT_SIZE + 2.0)
            _draw_points(ends, np.repeat(self._colors, 2, axis=0), POINT_SIZE)
        finally:
            gpu.state.point_size_set(1.0)
            gpu.state.depth_test_set(depth)
            gpu.state.blend_set(blend)


def bone_colors(placed: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """Colors (B,4) for flags (B,)."""
    colors = np.where(placed[:, None], PLACED, CARRIED)
    return np.where(kept[:, None], KEPT, colors)


def remove_overlays() -> None:
    """Stop all drawing."""
    while _shown:
        _shown[-1].remove()


def viewports() -> Iterator[bpy.types.Area]:
    """All 3D viewports on the screen."""
    for window in bpy.context.window_manager.windows:
        yield from (area for area in window.screen.areas if area.type == "VIEW_3D")


def redraw() -> None:
    """Have all 3D viewports drawn again."""
    for area in viewports():
        area.tag_redraw()


def _draw_lines(ends: np.ndarray, colors: np.ndarray, width: float) -> None:
    shader = gpu.shader.from_builtin("POLYLINE_FLAT_COLOR")
    batch = batch_for_shader(shader, "LINES", {"pos": ends, "color": colors})
    shader.bind()
    shader.uniform_float("viewportSize", gpu.state.viewport_get()[2:])
    shader.uniform_float("lineWidth", width)
    batch.draw(shader)


def _draw_points(points: np.ndarray, colors: np.ndarray, size: float) -> None:
    # Blender 4.5 gave points a shader of their own.
    name = "POINT_FLAT_COLOR" if bpy.app.version >= (4, 5, 0) else "FLAT_COLOR"
    shader = gpu.shader.from_builtin(name)
    batch = batch_for_shader(shader, "POINTS", {"pos": points, "color": colors})
    gpu.state.point_size_set(size)
    batch.draw(shader)
