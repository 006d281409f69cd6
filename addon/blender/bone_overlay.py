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
LINE_WIDTH = 2.5
# Joints are octahedra with this share of the skeleton's size as radius, or of their bone's length.
JOINT_SIZE = 0.01
JOINT_SHARE = 0.2
CORNERS = np.array([(1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], np.float32)
FACES = np.array([(end, side, (side + 1) % 4) for end in (4, 5) for side in range(4)])

_shown: list["BoneOverlay"] = []


class BoneOverlay:
    """Bones as lines with octahedra at their joints; it keeps arrays, never Blender's objects."""

    def __init__(self, heads: np.ndarray, tails: np.ndarray, colors: np.ndarray) -> None:
        self._ends = np.stack([heads, tails], axis=1).reshape(-1, 3).astype(np.float32)
        self._colors = np.repeat(colors.astype(np.float32), 2, axis=0)
        lengths = np.linalg.norm(tails - heads, axis=1)
        radius = JOINT_SIZE * np.ptp(self._ends, axis=0).max(initial=0.0)
        self._radii = np.repeat(np.minimum(JOINT_SHARE * lengths, radius), 2)
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
            outline = np.full_like(self._colors, OUTLINE)
            _draw_lines(self._ends, outline, LINE_WIDTH + 2.0)
            _draw_joints(self._ends, outline, 1.4 * self._radii)
            _draw_lines(self._ends, self._colors, LINE_WIDTH)
            _draw_joints(self._ends, self._colors, self._radii)
        finally:
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


def _draw_joints(points: np.ndarray, colors: np.ndarray, radii: np.ndarray) -> None:
    shader = gpu.shader.from_builtin("FLAT_COLOR")
    corners = points[:, None, None] + radii[:, None, None, None] * CORNERS[FACES]
    content = {
        "pos": np.ascontiguousarray(corners.reshape(-1, 3), np.float32),
        "color": np.repeat(colors, FACES.size, axis=0),
    }
    shader.bind()
    batch_for_shader(shader, "TRIS", content).draw(shader)
