# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces that hardly are bodies, as vertices and faces."""

import characters as c


def flat_sheet():
    return [(x, 0, z) for z in range(5) for x in range(5)], [
        (5 * z + x, 5 * z + x + 1, 5 * z + x + 6, 5 * z + x + 5) for z in range(4) for x in range(4)
    ]


def far_apart():
    vertices, faces = c.tube(8, 6)
    count = len(vertices)
    moved = [(x + 500, y, z) for x, y, z in vertices]
    return vertices + moved, faces + [tuple(i + count for i in face) for face in faces]


ODD_BODIES = {
    "flat sheet": flat_sheet(),
    "pieces far apart": far_apart(),
    "no volume": ([(0, 0, 0), (0, 0, 1), (0, 0, 2)], [(0, 1, 2)]),
    "one point": ([(0, 0, 0)] * 3, [(0, 1, 2)]),
    "tube": c.tube(12, 13),
}
