# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator that gives the selected meshes weights for an armature, from its bones alone."""

import bpy
from bpy.props import BoolProperty, EnumProperty, IntProperty

from ..blender.bind_job import BindJob
from ..blender.scope import Scope
from ..core.bind import BindSettings
from ..core.merge import MergeSettings
from .bind_selection import bind_armature, bind_meshes, missing_bind
from .modal_job import ModalJobOperator


class DERMIS_OT_bind_weights(ModalJobOperator, bpy.types.Operator):
    """Selected meshes to the active armature."""

    bl_idname = "dermis.bind_weights"
    bl_label = "Bind Weights"
    bl_description = (
        "Let the active armature deform the selected meshes, with weights made from its bones through the volume of "
        "the body. Works on any mesh; locked vertex groups stay as they are"
    )
    bl_options = {"REGISTER", "UNDO", "PRESET"}
    doing = "Binding"

    method: EnumProperty(
        name="Method",
        description="How a vertex finds its bones",
        items=(
            ("VOLUMETRIC", "Volumetric", "By the way through the body, with a smooth falloff over the surface"),
            ("PAPER", "Paper", "By the distance through the air to the two or three nearest bones, as published"),
        ),
        default="VOLUMETRIC",
    )
    use_together: BoolProperty(
        name="Meshes as One Body",
        description="Take all selected meshes as one body, so that clothes, eyes and buttons follow what they are on; "
        "otherwise each mesh is a body of its own",
        default=True,
    )
    geometry: EnumProperty(
        name="Geometry",
        description="Shape of the meshes and pose of the bones that are used",
        items=(
            ("REST", "Rest", "The meshes and the bones as they were made, without shape keys, modifiers and pose"),
            (
                "EVALUATED",
                "Evaluated",
                "The meshes and the bones as they are shown now, with shape keys, modifiers and pose",
            ),
        ),
        default="REST",
    )
    subset: EnumProperty(
        name="Subset",
        description="Vertex groups that are written. Locked groups never are",
        items=(
            ("DEFORM", "Deform Bones", "Groups of deforming bones; missing groups are made"),
            ("SELECTED", "Selected Bones", "Groups of the bones selected in the armature, or of the active one"),
            ("UNLOCKED", "Unlocked Groups", "Groups that the mesh has and that are not locked; none is made"),
        ),
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

    @classmethod
    def poll(cls, context):
        """An armature and meshes are needed, outside Edit Mode."""
        reason = missing_bind(context)
        if reason:
            cls.poll_message_set(reason)
        return not reason

    def draw(self, context):
        """Draw the options of Adjust Last Operation."""
        layout = self.layout
        layout.use_property_split = True
        for names in (
            ("method", "use_together", "geometry"),
            ("subset", "other_groups", "only_selected"),
            ("replace", "max_influences"),
        ):
            column = layout.column(align=True)
            for name in names:
                row = column.row()
                row.active = name != "other_groups" or self.subset != "DEFORM"
                row.prop(self, name)

    def job(self, context) -> BindJob:
        """Read and check what is selected."""
        return BindJob(
            bind_armature(context),
            bind_meshes(context),
            self.geometry == "EVALUATED",
            BindSettings(
                method=self.method.lower(),
                together=self.use_together,
                merge=MergeSettings(
                    replace=self.replace,
                    max_influences=self.max_influences or None,
                    other_groups=self.other_groups.lower(),
                ),
            ),
            context.evaluated_depsgraph_get(),
            Scope(self.subset, self.only_selected),
        )

    def finished(self, job: BindJob) -> set[str]:
        """Write the weights and tell what was done."""
        line, notes = job.finish()
        self.report({"INFO"}, " ".join([line, *notes]))
        return {"FINISHED"}
