# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether an object's data may be written to."""

import bpy

from ..core.errors import InputError, listed


def check_writable(ob: bpy.types.Object, data: str = "mesh", changed: str = "vertex groups") -> None:
    """Raise InputError for linked data, library overrides and data that several objects use.

    data is what the object's data is called, changed what of it would change.
    """
    for owner, what in ((ob, "object"), (ob.data, data)):
        if owner.library is not None:
            raise InputError(
                f"The {what} '{owner.name}' is linked from '{owner.library.filepath}' and cannot be changed: "
                "use Object > Relations > Make Local first."
            )
        if owner.override_library is not None:
            raise InputError(
                f"The {what} '{owner.name}' is a library override, whose {changed} cannot be changed: "
                "use Object > Library Override > Clear or Make Local first."
            )
    users = [other.name for other in bpy.data.objects if other.data == ob.data]
    if len(users) > 1:
        raise InputError(
            f"The {data} '{ob.data.name}' is used by {listed(users)}, which would all change: "
            "use Object > Relations > Make Single User > Object & Data first."
        )
