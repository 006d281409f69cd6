# SPDX-License-Identifier: GPL-3.0-or-later
"""Vertices of one finger or toe that follow another."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from .bones import distances_to_bones
from .character import Bones, BoneWeights, Flags, Floats, Integers

_WORDS = re.compile(r"thumb|index|middle|ring|pink|little|finger", re.IGNORECASE)
# A hand has at least so many fingers, each of at least so many bones.
FEWEST_FINGERS = 3
FEWEST_BONES = 2
# Without names that tell, fingers are shorter than this share of the skeleton's extent.
LONGEST = 0.15
# Along the first bone from here on, and on all that follow, a vertex is clear of the palm.
CLEAR_OF_PALM = 0.6
# Weight on a second finger, clear of the palm, from which it is bleeding.
BLEEDING = 0.1
# A finger that is this much farther away than the nearest one cannot be the vertex's own.
FARTHER = 1.5


@dataclass(frozen=True)
class Hand:
    """A bone and the finger chains below it, each a tuple of bones from the palm outwards."""

    bone: int
    fingers: tuple[tuple[int, ...], ...]


def find_hands(bones: Bones) -> list[Hand]:
    """Hands and feet: bones with several chains that do not branch, by name where any is named like a finger."""
    children: list[list[int]] = [[] for _ in range(len(bones))]
    for bone, parent in enumerate(bones.parents.tolist()):
        if parent >= 0:
            children[parent].append(bone)
    named = [bool(_WORDS.search(name)) for name in bones.names]
    lengths = np.linalg.norm(bones.tails - bones.heads, axis=1)
    extent = float(np.ptp(np.concatenate([bones.heads, bones.tails]), axis=0).max())
    hands = []
    for bone in range(len(bones)):
        chains = [chain for child in children[bone] if (chain := _chain(child, children)) is not None]
        if any(named):
            fingers = [chain for chain in chains if any(named[link] for link in chain)]
        else:
            fingers = [chain for chain in chains if lengths[list(chain)].sum() < LONGEST * extent]
        fingers = [chain for chain in fingers if len(chain) >= FEWEST_BONES]
        if len(fingers) >= FEWEST_FINGERS:
            hands.append(Hand(bone, tuple(fingers)))
    return hands


def bleeding_fingers(points: Floats, bones: Bones, weights: BoneWeights) -> Flags:
    """Vertices (V,) clear of the palm that follow two fingers, or one that is farther away than another."""
    wrong = np.zeros(len(points), np.bool_)
    for hand in find_hands(bones):
        finger_of = np.full(len(bones), -1, np.int32)
        for index, chain in enumerate(hand.fingers):
            finger_of[list(chain)] = index
        mine = weights.where((finger_of[weights.bone] >= 0) & (weights.value > 0))
        vertices, row = np.unique(mine.vertex, return_inverse=True)
        share = np.zeros((len(vertices), len(hand.fingers)))
        np.add.at(share, (row, finger_of[mine.bone]), mine.value)
        wrong[vertices[_bleeds(points[vertices], bones, hand, share)]] = True
    return wrong


def _bleeds(points: Floats, bones: Bones, hand: Hand, share: Floats) -> Flags:
    """Which points (n,3) with these weights (n,F) on the fingers bleed."""
    links = [link for chain in hand.fingers for link in chain]
    owner = np.repeat(np.arange(len(hand.fingers)), [len(chain) for chain in hand.fingers])
    distances = distances_to_bones(points, bones.subset(links))
    nearest_link = distances.argmin(axis=1)
    of_finger = np.stack([distances[:, owner == f].min(axis=1) for f in range(len(hand.fingers))], axis=1)
    nearest = of_finger.min(axis=1)
    is_first = np.array([link == chain[0] for chain in hand.fingers for link in chain])
    clear = ~is_first[nearest_link] | (_along(points, bones, np.array(links)[nearest_link]) > CLEAR_OF_PALM)
    rows = np.arange(len(points))
    main = share.argmax(axis=1)
    ordered = np.sort(share, axis=1)
    two = ordered[:, -2] > BLEEDING
    other = (ordered[:, -1] > BLEEDING) & (of_finger[rows, main] > FARTHER * nearest)
    bleeds: Flags = clear & (two | other)
    return bleeds


def _along(points: Floats, bones: Bones, bone: Integers) -> Floats:
    """Place (n,) of each point along its bone, 0 at the head and 1 at the tail."""
    axes = bones.tails[bone] - bones.heads[bone]
    squared = np.einsum("nk,nk->n", axes, axes)
    along: Floats = np.einsum("nk,nk->n", points - bones.heads[bone], axes) / np.where(squared > 0, squared, 1.0)
    return along


def _chain(bone: int, children: list[list[int]]) -> tuple[int, ...] | None:
    """The bone and all below it, None where they branch."""
    chain = [bone]
    while children[chain[-1]]:
        if len(children[chain[-1]]) > 1:
            return None
        chain.append(children[chain[-1]][0])
    return tuple(chain)
