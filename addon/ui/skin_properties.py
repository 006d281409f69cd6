# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of the PBD skin on mesh objects."""

from time import monotonic

import bpy
from bpy.props import (
    BoolProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from ..blender.skin_key import find_key
from ..blender.skin_state import registry
from ..core.skin_settings import preset_values

# A setting that is being dragged waits this long for its last value before a skin is built.
PATIENCE_SECONDS = 0.3

DEFAULTS = preset_values("default")

# Every setting but the shape key's value needs another skin, so none of them can be animated:
# their options are empty.

IDENTITY = tuple(float(row == column) for row in range(4) for column in range(4))

_filling = False


def _changed(kept, _context):
    """Let the skin be rebuilt: at once without a window, otherwise when the value has settled."""
    if _filling or not kept.enabled:
        return
    ob = kept.id_data
    if not bpy.app.background:
        registry.state(ob).hold_until = monotonic() + PATIENCE_SECONDS
        if not bpy.app.timers.is_registered(_settle):
            bpy.app.timers.register(_settle, first_interval=PATIENCE_SECONDS)
    ob.update_tag(refresh={"OBJECT"})


def _settle():
    """Timer: tag the skins whose settings have settled; come back while others have not."""
    waiting = False
    for ob in registry.objects():
        state = registry.state(ob)
        if state.is_held:
            waiting = True
        elif state.hold_until:
            state.hold_until = 0.0
            ob.update_tag(refresh={"OBJECT"})
    return PATIENCE_SECONDS / 2 if waiting else None


def _fill(kept, context):
    """A preset was chosen: take over its values."""
    global _filling
    _filling = True
    try:
        for name, value in preset_values(kept.preset.lower()).items():
            setattr(kept, name, value.upper() if name == "start" else value)
    finally:
        _filling = False
    _changed(kept, context)


def _mask(kept, _context):
    """The mask is the shape key's own."""
    key = find_key(kept.id_data) if kept.enabled else None
    if key is not None:
        key.vertex_group = kept.mask_group


def _strength(name, description, attribute):
    return FloatProperty(
        name=name,
        description=description,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        default=DEFAULTS[attribute],
        options=set(),
        update=_changed,
    )


class DermisSkin(bpy.types.PropertyGroup):
    """How the skin of this mesh is solved, and where it was bound."""

    preset: EnumProperty(
        name="Preset",
        description="Fills the settings below with those of a published or measured method",
        items=(
            ("DEFAULT", "Default", "What keeps volume and folds best by measurement"),
            ("PAPER", "Paper", "Algorithm 1 as printed: all constraints at full strength from linear blend skinning"),
            (
                "RUMMAN_FRATARCANGELI",
                "Rumman & Fratarcangeli",
                "Stretch, volume and bind constraints alone: no energy, no self-collision",
            ),
        ),
        default="DEFAULT",
        options=set(),
        update=_fill,
    )
    iterations: IntProperty(
        name="Iterations",
        description="How often all constraints are projected in a frame; more keep more volume and take longer",
        min=0,
        soft_max=100,
        max=10000,
        default=DEFAULTS["iterations"],
        options=set(),
        update=_changed,
    )
    start: EnumProperty(
        name="Start",
        description="Where the cage starts in each frame",
        items=(
            ("AUTO", "Auto", "What measures best"),
            ("LINEAR", "Linear Blend", "As published; collapses at twists near a half turn"),
            ("DUAL_QUATERNION", "Dual Quaternion", "Nearest to the solution for twists and bends"),
        ),
        default=DEFAULTS["start"].upper(),
        options=set(),
        update=_changed,
    )
    stretch: _strength("Stretch", "How firmly edges of the cage keep their length", "stretch")
    volume: _strength("Volume", "How firmly tetrahedra of the cage keep their volume", "volume")
    bind: _strength("Bind", "How firmly the inside of the cage follows the nearest bone", "bind")
    energy: _strength("Energy", "How much the elastic energy of the stiffness counts", "energy")
    stiffness: FloatProperty(
        name="Stiffness",
        description="Spring constant of the material: soft flesh is below 1, a firm joint far above. "
        "It acts through Energy",
        min=1e-4,
        soft_min=0.01,
        soft_max=1e4,
        max=1e8,
        default=DEFAULTS["stiffness"],
        options=set(),
        update=_changed,
    )
    self_collision: BoolProperty(
        name="Self-Collision",
        description="Let folds of a joint touch instead of passing through each other",
        default=DEFAULTS["self_collision"],
        options=set(),
        update=_changed,
    )
    smoothing: _strength("Smoothing", "How much the correction, not the skin itself, is smoothed", "smoothing")
    cell_size: FloatProperty(
        name="Cell Size",
        description="Quality: size of the cage's cells. Smaller cells follow thinner limbs and take longer; "
        "0 lets the thickness at each joint decide",
        subtype="DISTANCE",
        unit="LENGTH",
        min=0.0,
        soft_max=0.2,
        max=100.0,
        precision=4,
        default=0.0,
        options=set(),
        update=_changed,
    )
    mask_group: StringProperty(
        name="Mask",
        description="Vertex group that says how much of the correction each vertex gets; all of it when empty",
        options=set(),
        update=_mask,
    )
    stiffness_group: StringProperty(
        name="Stiffness Group",
        description="Vertex group that says how much of the stiffness each vertex has; even when empty",
        options=set(),
        update=_changed,
    )
    enabled: BoolProperty(
        name="Enabled", description="Whether the object has a PBD skin; use the operators", options={"HIDDEN"}
    )
    baked: StringProperty(
        name="Baked",
        description="What stands in for the live skin: CACHE, KEYS, WEIGHTS or nothing; use the operators",
        options={"HIDDEN"},
    )
    key_was_muted: BoolProperty(
        name="Key Was Muted", description="Whether the skin's key was muted before it was baked", options={"HIDDEN"}
    )
    baked_keys: StringProperty(
        name="Baked Keys", description="Shape keys that stand in for the live skin, one a line", options={"HIDDEN"}
    )
    made_basis: BoolProperty(
        name="Made Basis", description="Whether the skin brought the Basis shape key", options={"HIDDEN"}
    )
    object_matrix: FloatVectorProperty(
        name="Object Matrix",
        description="From the object's space to the solver's, chosen when the skin was bound",
        size=16,
        default=IDENTITY,
        options={"HIDDEN"},
    )
    armature_matrix: FloatVectorProperty(
        name="Armature Matrix",
        description="From the armature's space to the solver's, chosen when the skin was bound",
        size=16,
        default=IDENTITY,
        options={"HIDDEN"},
    )
    geometry_key: StringProperty(
        name="Geometry",
        description="Hash of the mesh, weights and bones that the skin was bound to",
        options={"HIDDEN"},
    )


def register() -> None:
    """Register the property group and put one on objects."""
    bpy.utils.register_class(DermisSkin)
    bpy.types.Object.dermis_skin = PointerProperty(type=DermisSkin)


def unregister() -> None:
    """Take it away; what files hold of it stays there."""
    if bpy.app.timers.is_registered(_settle):
        bpy.app.timers.unregister(_settle)
    del bpy.types.Object.dermis_skin
    bpy.utils.unregister_class(DermisSkin)
