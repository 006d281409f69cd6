# SPDX-License-Identifier: GPL-3.0-or-later
"""The weights that a refit replaced, kept in the mesh until the live skin comes back."""

import json
import zlib

import bpy
import numpy as np

from ..core.errors import InputError
from .vertex_groups import GroupWeights, restore_groups

# Custom property of the mesh.
PROPERTY = "dermis_weights_before"


def keep_weights(ob: bpy.types.Object, groups: GroupWeights) -> None:
    """Keep all vertex groups as they are now."""
    head = {
        "names": groups.names,
        "locked": groups.locked.tolist(),
        "active": groups.active,
        "vertices": len(groups.counts),
        "entries": len(groups.group),
    }
    arrays = (groups.counts.astype("<i4"), groups.group.astype("<i4"), groups.value.astype("<f4"))
    ob.data[PROPERTY] = zlib.compress(json.dumps(head).encode() + b"\0" + b"".join(a.tobytes() for a in arrays))


def check_kept_weights(ob: bpy.types.Object) -> None:
    """Raise InputError where the kept weights are gone or belong to another number of vertices."""
    if PROPERTY not in ob.data:
        raise InputError(f"The weights that '{ob.name}' had before the refit are gone: undo, or remove them by hand.")
    count = len(_kept(ob).counts)
    if count != len(ob.data.vertices):
        raise InputError(
            f"'{ob.name}' had {count} vertices when its weights were refitted and has {len(ob.data.vertices)} now: "
            "the old weights do not fit any more."
        )


def restore_kept_weights(ob: bpy.types.Object) -> None:
    """Bring the kept vertex groups back, bit for bit."""
    restore_groups(ob, _kept(ob))
    del ob.data[PROPERTY]


def _kept(ob: bpy.types.Object) -> GroupWeights:
    text, _, data = zlib.decompress(ob.data[PROPERTY]).partition(b"\0")
    head = json.loads(text)
    vertices, entries = head["vertices"], head["entries"]
    integers = np.frombuffer(data, "<i4", vertices + entries)
    return GroupWeights(
        names=tuple(head["names"]),
        locked=np.array(head["locked"], np.bool_),
        active=head["active"],
        counts=integers[:vertices].astype(np.int32),
        group=integers[vertices:].astype(np.int32),
        value=np.frombuffer(data, "<f4", entries, 4 * len(integers)).astype(np.float32),
    )
