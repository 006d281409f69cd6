"""The default skin through whole motions and deep poses: many joints at once."""

from itertools import pairwise

import numpy as np
import pytest
from deformation import crossing_pairs, volume
from dermis_native import PbdSkin, SkinWeights, linear_blend_skinning
from motions import DEEP_POSES, posed, recorded, walk
from surfaces import adult

# Crossing triangles are looked for in so many frames of a motion, and not among the many small ones of
# the head and the fingers.
LOOKS = 2
SMALL = ("head", "thumb", "index", "middle", "ring", "pinky")


class Figures:
    """What plain skinning and the skin make of poses, one after the other."""

    def __init__(self, mesh, skeleton, weights, poses, looks):
        rest, triangles = mesh.vertices, mesh.triangles
        left_out = [b for b, name in enumerate(skeleton.names) if name.startswith(SMALL)]
        small = weights.to_dense()[:, left_out].sum(axis=1) > 0.5
        body = triangles[~small[triangles].any(axis=1)]
        skin = PbdSkin(mesh, skeleton, weights)
        whole, at_rest = volume(rest, triangles), crossing_pairs(rest, body)
        self.errors, self.crossings, corrections = np.zeros(2), np.zeros(2, int), []
        self.inverted = 0
        for frame, transforms in enumerate(poses):
            surfaces = linear_blend_skinning(rest, weights, transforms), skin.solve(transforms)
            self.inverted += skin.stats["inverted"]
            self.errors += [abs(volume(surface, triangles) - whole) for surface in surfaces]
            corrections.append(surfaces[1] - surfaces[0])
            if frame in looks:
                self.crossings += [len(crossing_pairs(surface, body) - at_rest) for surface in surfaces]
        changes = [np.linalg.norm(b - a, axis=1).max() for a, b in pairwise(corrections)]
        self.pop = max(changes) / np.median(changes)

    def check_bounds(self):
        print(f"volume error {self.errors[1] / self.errors[0]:.1%} of plain, ", end="")
        print(
            f"crossing pairs {self.crossings[1]} of {self.crossings[0]}, largest change {self.pop:.1f} times the median"
        )
        assert self.inverted == 0
        assert self.errors[1] <= 0.15 * self.errors[0]


def spread(count):
    return {count * look // LOOKS for look in range(LOOKS)}


@pytest.fixture(scope="module")
def person():
    mesh, skeleton, weights = adult()
    return mesh, skeleton, SkinWeights.from_dense(weights)


def test_a_walk(person):
    figures = Figures(*person, walk(person[1], 24), looks=())
    figures.check_bounds()
    assert figures.pop <= 3


def test_deep_poses(person):
    poses = [posed(person[1], degrees) for degrees in DEEP_POSES.values()]
    figures = Figures(*person, poses, looks=range(len(poses)))
    figures.check_bounds()
    assert figures.crossings[1] <= 0.03 * figures.crossings[0]


@pytest.mark.parametrize("clip", ["walk", "zombie"])
def test_recorded_motions(clip):
    found = recorded(clip)
    if found is None:
        pytest.skip("needs the recorded clips in ../shared/data")
    figures = Figures(*found, looks=spread(len(found[-1])))
    figures.check_bounds()
    if clip == "walk":
        assert figures.pop <= 3, "the other clip is not smooth itself"
        assert figures.crossings[1] <= 0.03 * figures.crossings[0]
