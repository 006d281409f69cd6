# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the vertices of a target got their weights from: kept on the object, shown as colors."""

import base64
import binascii
import zlib

import bpy
import numpy as np

from ..core.errors import InputError
from ..core.retarget import FILLED, KEPT, MATCHED, PART

ATTRIBUTE = "Dermis Match"
# Linear colors: vertices that kept what they had, that were matched, filled in, treated as a loose part.
COLORS = {
    KEPT: (0.2, 0.2, 0.2, 1.0),
    MATCHED: (0.02, 0.35, 0.6, 1.0),
    FILLED: (1.0, 0.35, 0.02, 1.0),
    PART: (0.4, 0.05, 0.6, 1.0),
}


def keep_status(ob: bpy.types.Object, status: np.ndarray) -> None:
    """Remember the status (V,) of each vertex on the object."""
    packed = zlib.compress(np.ascontiguousarray(status, np.uint8).tobytes())
    ob.dermis_retarget.status = base64.b64encode(packed).decode("ascii")


def kept_status(ob: bpy.types.Object) -> np.ndarray | None:
    """The status (V,) of the last retargeting; None without one or where the mesh has other vertices now."""
    try:
        raw = zlib.decompress(base64.b64decode(ob.dermis_retarget.status, validate=True))
    except (zlib.error, binascii.Error):
        return None
    status = np.frombuffer(raw, np.uint8)
    return status if len(status) and len(status) == len(ob.data.vertices) else None


def show_status(mesh: bpy.types.Mesh, status: np.ndarray) -> None:
    """Write the status (V,) as a color attribute and make it the one that is shown."""
    attribute = mesh.attributes.get(ATTRIBUTE)
    if attribute is None:
        mesh.color_attributes.new(ATTRIBUTE, "BYTE_COLOR", "POINT")
    elif not _takes_colors(attribute):
        raise InputError(f"'{mesh.name}' has another attribute '{ATTRIBUTE}', which cannot hold the colors: rename it.")
    table = np.zeros((256, 4), np.float32)
    for code, color in COLORS.items():
        table[code] = color
    mesh.attributes[ATTRIBUTE].data.foreach_set("color", table[status].ravel())
    mesh.color_attributes.active_color_name = ATTRIBUTE
    mesh.update()


def shows_status(mesh: bpy.types.Mesh) -> bool:
    """Whether the mesh has the colors of an earlier run."""
    return ATTRIBUTE in mesh.attributes and _takes_colors(mesh.attributes[ATTRIBUTE])


def read_colors(mesh: bpy.types.Mesh) -> np.ndarray | None:
    """The colors (V,4) that the mesh has, None where it has none."""
    if not shows_status(mesh):
        return None
    colors = np.empty(len(mesh.vertices) * 4, np.float32)
    mesh.attributes[ATTRIBUTE].data.foreach_get("color", colors)
    return colors.reshape(-1, 4)


def restore_colors(mesh: bpy.types.Mesh, colors: np.ndarray | None, active: str) -> None:
    """Bring back what `read_colors` gave, and the color attribute that was shown."""
    if colors is None and shows_status(mesh):
        mesh.attributes.remove(mesh.attributes[ATTRIBUTE])
    elif colors is not None:
        mesh.attributes[ATTRIBUTE].data.foreach_set("color", colors.ravel())
    mesh.color_attributes.active_color_name = active


def _takes_colors(attribute: bpy.types.Attribute) -> bool:
    return (attribute.domain, attribute.data_type) == ("POINT", "BYTE_COLOR")
