# SPDX-License-Identifier: GPL-3.0-or-later
"""Options of all operators that write weights: which groups, vertices and parts, and how much."""

from bpy.props import BoolProperty, EnumProperty, IntProperty, StringProperty

from ..blender.scope import Scope
from ..core.merge import MergeSettings

SUBSETS = (
    ("DEFORM", "Deform Bones", "Groups of deforming bones; missing groups are made"),
    ("SELECTED", "Selected Bones", "Groups of the bones selected in the mesh's armature, or of the active one"),
    ("UNLOCKED", "Unlocked Groups", "Groups that the mesh has and that are not locked; none is made"),
)
# Subsets beside which there are other groups of deforming bones.
PARTIAL_SUBSETS = ("SELECTED", "UNLOCKED")


class WeightOptions:
    """Mixin for operators that write weights, or tell what would be written."""

    subset: EnumProperty(
        name="Subset",
        description="Vertex groups that are written. Locked groups never are",
        items=SUBSETS,
        default="DEFORM",
    )
    other_groups: EnumProperty(
        name="Other Groups",
        description="What happens to groups of deforming bones that are neither in the subset nor locked",
        items=(
            ("KEEP", "Keep", "They stay exactly as they are; groups of the subset share what is left of a total of 1"),
            ("SCALE", "Scale", "They give way, so that groups of the subset get their full weight and totals stay 1"),
        ),
        default="KEEP",
    )
    only_selected: BoolProperty(
        name="Only Selected Vertices",
        description="Write the weights of the selected vertices alone; others stay exactly as they are",
        default=False,
    )
    protected_group: StringProperty(
        name="Protected",
        description="Vertex group whose vertices keep all their weights exactly as they are; empty for none",
        default="",
    )
    parts_of_selection: BoolProperty(
        name="Only Parts with Selection",
        description="Apply Loose Parts to the parts with a selected vertex alone; it is chosen for the others. The "
        "body then counts like any other part",
        default=False,
    )
    replace: BoolProperty(
        name="Replace Existing",
        description="Replace the bone weights that a mesh has; otherwise only vertices without any get weights",
        default=True,
    )
    max_influences: IntProperty(
        name="Limit Influences",
        description="Most bones that one vertex may follow; 0 for any number. Game engines often want 4 or 8. "
        "Weights fade out towards the limit, so that neighbors do not jump",
        min=0,
        soft_max=8,
        max=64,
        default=0,
    )

    def draw_options(self, layout, objects, blocks):
        """Draw properties by name, each block of them together; `objects` are the meshes to write to."""
        idle = {
            "other_groups": self.subset not in PARTIAL_SUBSETS,
            "loose_parts": self.method == "PAPER",
            "parts_of_selection": self.method == "PAPER" or self.loose_parts == "AUTO",
        }
        for names in blocks:
            column = layout.column(align=True)
            for name in names:
                row = column.row()
                row.active = not idle.get(name, False)
                if name == "protected_group" and objects:
                    row.prop_search(self, name, objects[0], "vertex_groups")
                else:
                    row.prop(self, name)

    def scope(self) -> Scope:
        """Which groups, vertices and parts."""
        return Scope(self.subset, self.only_selected, self.protected_group, self.parts_of_selection)

    def parts(self) -> str:
        """What becomes of loose parts; the paper's methods know none."""
        return "auto" if self.method == "PAPER" else self.loose_parts.lower()

    def merge(self, mix: float = 1.0) -> MergeSettings:
        """How new weights meet old ones."""
        return MergeSettings(
            replace=self.replace,
            mix=mix,
            max_influences=self.max_influences or None,
            other_groups=self.other_groups.lower(),
        )
