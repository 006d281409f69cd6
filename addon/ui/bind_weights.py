# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator that gives the selected meshes weights for an armature, from its bones alone."""

import bpy
from bpy.props import BoolProperty, EnumProperty

from ..blender.bind_job import BindJob
from ..core.bind import BindSettings
from .bind_selection import bind_armature, bind_meshes, missing_bind
from .modal_job import ModalJobOperator
from .weight_options import WeightOptions


class DERMIS_OT_bind_weights(WeightOptions, ModalJobOperator, bpy.types.Operator):
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
    loose_parts: EnumProperty(
        name="Loose Parts",
        description="What becomes of pieces that are not connected to the largest one",
        items=(
            ("AUTO", "Auto", "Small ones and those that no bone reaches go with the body, others have their own bones"),
            ("RIGID", "Rigid", "Each moves as one, like a button or a tooth"),
            ("SURFACE", "Surface", "Each follows the nearest surface of the body, like a strap or a hair card"),
            ("OWN", "Own Bones", "Each is bound to the bones that are near, like an arm that is an object of its own"),
        ),
        default="AUTO",
    )

    @classmethod
    def missing(cls, context) -> str:
        """An armature and meshes are needed, outside Edit Mode."""
        return missing_bind(context)

    def draw(self, context):
        """Draw the options of Adjust Last Operation."""
        layout = self.layout
        layout.use_property_split = True
        self.draw_options(
            layout,
            bind_meshes(context),
            (
                ("method", "use_together", "geometry"),
                ("loose_parts", "parts_of_selection"),
                ("subset", "other_groups", "only_selected", "protected_group"),
                ("replace", "max_influences"),
            ),
        )

    def job(self, context) -> BindJob:
        """Read and check what is selected."""
        return BindJob(
            bind_armature(context),
            bind_meshes(context),
            self.geometry == "EVALUATED",
            BindSettings(
                method=self.method.lower(),
                together=self.use_together,
                parts=self.parts(),
                merge=self.merge(),
            ),
            context.evaluated_depsgraph_get(),
            self.scope(),
        )

    def finished(self, job: BindJob) -> set[str]:
        """Write the weights and tell what was done."""
        line, notes = job.finish()
        self.tell({"INFO"}, " ".join([line, *notes]))
        return {"FINISHED"}
