# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether an object can show a PBD skin, asked before it gets one and in every frame.

The skin is a shape key under the Armature modifier: whatever stands between the two, or moves the
vertices in another way, makes it wrong, so it is refused by name.
"""

import bpy

from ..core.errors import InputError, listed

# Modifiers that leave the vertices alone and may stand before the Armature modifier.
HARMLESS = {"NORMAL_EDIT", "UV_PROJECT", "UV_WARP", "WEIGHTED_NORMAL"}


def check_owner(ob: bpy.types.Object) -> None:
    """Raise InputError where a shape key would be lost or would show on another object too."""
    for owner, what in ((ob, "object"), (ob.data, "mesh")):
        if owner.library is not None:
            raise InputError(
                f"The {what} '{owner.name}' is linked from '{owner.library.filepath}' and cannot keep a shape key: "
                "use Object > Library Override > Make and then Bake Point Cache, or bake the skin in that file."
            )
        if owner.override_library is not None:
            raise InputError(
                f"The {what} '{owner.name}' is a library override, which cannot keep a shape key: "
                "use Bake Point Cache, or Object > Library Override > Make Local first."
            )
    if ob.data.users - ob.data.use_fake_user > 1:
        users = [other.name for other in bpy.data.objects if other.data == ob.data]
        if len(users) > 1:
            raise InputError(
                f"The mesh '{ob.data.name}' is used by {listed(users)}: "
                "use Object > Relations > Make Single User > Object & Data first."
            )


def skin_modifier(ob: bpy.types.Object) -> bpy.types.ArmatureModifier:
    """The object's only Armature modifier, in a stack where a shape key can correct it."""
    found = None
    before = []
    for modifier in ob.modifiers:
        if not (modifier.show_viewport or modifier.show_render):
            continue
        if modifier.type == "ARMATURE":
            if modifier.object is None:
                continue
            if found is not None:
                raise InputError(
                    f"'{ob.name}' has several Armature modifiers ('{found.name}', '{modifier.name}'): keep one."
                )
            found = modifier
        elif found is None and modifier.type not in HARMLESS:
            before.append(modifier)
    by_parent = ob.parent is not None and ob.parent.type == "ARMATURE" and ob.parent_type == "ARMATURE"
    if by_parent:
        raise InputError(
            f"'{ob.name}' is parented to '{ob.parent.name}' by Armature Deform of an old file: "
            "use an Armature modifier instead."
        )
    if found is None:
        raise InputError(f"'{ob.name}' has no armature: no Armature modifier that is shown has one.")
    if before:
        raise InputError(
            f"'{ob.name}' has '{before[0].name}' before its Armature modifier '{found.name}': "
            f"move '{found.name}' to the first place or apply '{before[0].name}'."
        )
    _check_settings(ob, found)
    return found


def _check_settings(ob: bpy.types.Object, modifier: bpy.types.ArmatureModifier) -> None:
    if modifier.use_bone_envelopes:
        raise InputError(f"'{modifier.name}' of '{ob.name}' uses bone envelopes: switch Bone Envelopes off.")
    if not modifier.use_vertex_groups:
        raise InputError(f"'{modifier.name}' of '{ob.name}' does not use vertex groups: switch Vertex Groups on.")
    if modifier.use_multi_modifier:
        raise InputError(f"'{modifier.name}' of '{ob.name}' uses Multi Modifier: switch it off.")


def check_shape_keys(ob: bpy.types.Object) -> None:
    """Raise InputError where the object's shape keys do not add up."""
    keys = ob.data.shape_keys
    if keys is not None and not keys.use_relative:
        raise InputError(f"The shape keys of '{ob.name}' are absolute: switch Relative on.")
    if ob.show_only_shape_key:
        raise InputError(f"'{ob.name}' shows one shape key alone: switch Solo Active Shape Key (the pin) off.")
