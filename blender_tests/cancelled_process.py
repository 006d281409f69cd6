# SPDX-License-Identifier: GPL-3.0-or-later
"""Retargets in a thread, abandons it in the midst of native work and comes to the end of the process."""

import atexit
import importlib
import sys
import threading
from pathlib import Path

import numpy as np

# The extension without Blender, as an ordinary package.
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
character = importlib.import_module("addon.core.character")
task = importlib.import_module("addon.core.task")
retarget = importlib.import_module("addon.core.retarget")

SIDE = 150


def rolled(radius):
    """A tube of SIDE x SIDE vertices along z."""
    turn, height = np.meshgrid(np.arange(SIDE) * 2 * np.pi / SIDE, np.linspace(0, 3, SIDE))
    vertices = np.stack([radius * np.cos(turn), radius * np.sin(turn), height], axis=-1).reshape(-1, 3)
    row, column = np.meshgrid(np.arange(SIDE - 1), np.arange(SIDE), indexing="ij")
    a, b = row * SIDE + column, row * SIDE + (column + 1) % SIDE
    corners = np.stack([a, b, b + SIDE, a + SIDE], axis=-1).reshape(-1, 4)
    return character.Surface(vertices, np.full(len(corners), 4, np.int32), corners.ravel().astype(np.int32))


def main():
    """Begin, abandon, end."""
    heads = np.array([[0.0, 0, i] for i in range(3)])
    bones = character.Bones(("a", "b", "c"), heads, np.add(heads, (0, 0, 1)), np.array([-1, 0, 1], np.int32))
    surface = rolled(0.4)
    bone = np.minimum(surface.vertices[:, 2], 2.9).astype(np.int32)
    count = len(surface.vertices)
    weights = character.BoneWeights(np.arange(count, dtype=np.int32), bone, np.ones(count, np.float32))
    source = character.Source("Old", "OldRig", surface, bones, weights)
    empty = character.BoneWeights.none()
    target = character.Target("New", "NewRig", rolled(0.5), bones, empty, np.zeros(3, np.bool_))
    work = task.RetargetTask(source, [target], retarget.RetargetSettings())
    atexit.register(lambda: print("ended"))
    work.start()
    while work.fraction == 0 and not work.wait(0.001):
        pass
    print("running")
    work.abandon()
    assert any(thread.name == "dermis-retarget" for thread in threading.enumerate())
    print("abandoned")


main()
