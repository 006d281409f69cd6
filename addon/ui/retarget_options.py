# SPDX-License-Identifier: GPL-3.0-or-later
"""The options of a retargeting, and the job that they and the selection make."""

from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty

from ..blender.retarget import TargetChoice
from ..blender.retarget_job import GeometryChoice, RetargetJob
from ..core.retarget import RetargetSettings
from .selection import bone_pairs, landmark_pairs, source_of, targets_of
from .weight_options import SUBSETS, WeightOptions

GEOMETRY = (
    ("REST", "Rest", "The mesh and the bones as they were made, without shape keys, modifiers and pose"),
    ("EVALUATED", "Evaluated", "The mesh and the bones as they are shown now, with shape keys, modifiers and pose"),
)


class RetargetOptions(WeightOptions):
    """Mixin for operators that retarget, or tell what a retargeting would do."""

    method: EnumProperty(
        name="Method",
        description="How the vertices of the target find their place on the source",
        items=(
            ("AUTO", "Auto", "The best method that Dermis has"),
            ("PAPER", "Paper", "Biharmonic distances to landmarks and Shepard interpolation, as published"),
        ),
        default="AUTO",
    )
    use_landmarks: BoolProperty(
        name="Use Landmarks",
        description="Use the landmark pairs of the target, if it has any; otherwise they are chosen on the skeletons",
        default=True,
    )
    use_bone_map: BoolProperty(
        name="Use Bone List",
        description="Use the bone list of the target, if it has one; otherwise bones are mapped by name, naming "
        "scheme, structure and position",
        default=True,
    )
    source_geometry: EnumProperty(
        name="Source Geometry", description="Shape of the source that is matched", items=GEOMETRY, default="REST"
    )
    target_geometry: EnumProperty(
        name="Target Geometry", description="Shape of the targets that is matched", items=GEOMETRY, default="REST"
    )
    mirror: EnumProperty(
        name="Mirror",
        description="Use bones that are named left and right, such as hand.L and hand.R, to mirror the weights",
        items=(
            ("NONE", "None", "Left stays left and right stays right"),
            ("FLIP", "Flip", "The target's right side gets what the source's left side has, and the other way round"),
            ("LEFT", "Left to Both", "Both sides of the target get what the source's left side has"),
            ("RIGHT", "Right to Both", "Both sides of the target get what the source's right side has"),
        ),
        default="NONE",
    )
    loose_parts: EnumProperty(
        name="Loose Parts",
        description="What becomes of pieces of the target that are not connected to its largest one",
        items=(
            ("AUTO", "Auto", "Chosen for each part by its size, its shape and what the source has there"),
            ("RIGID", "Rigid", "Each moves as one, like an eye, a tooth or a button"),
            ("SURFACE", "Surface", "Each follows the nearest surface of the body, like lashes, straps and hair cards"),
            ("MATCH", "Match", "Each is matched with the source like the body, as a garment is"),
        ),
        default="AUTO",
    )
    subset: EnumProperty(
        name="Subset",
        description="Vertex groups of the targets that are written. Locked groups never are",
        items=(
            ("ALL", "All Groups", "Groups of deforming bones, and copies of the source's groups without a bone"),
            *SUBSETS,
        ),
        default="DEFORM",
    )
    keep_unmapped: BoolProperty(
        name="Keep Unmapped Bones",
        description="Merge: bones of the target that stand for no bone of the source keep their weights, as if they "
        "were locked, and the others share the rest; otherwise they lose them",
        default=False,
    )
    mix_factor: FloatProperty(
        name="Mix Factor",
        description="Share of the new weights where a vertex has weights already: 0 keeps those, 1 takes the new ones",
        min=0.0,
        max=1.0,
        default=1.0,
        subtype="FACTOR",
    )
    close_seams: BoolProperty(
        name="Close Seams",
        description="Give vertices at open edges that lie at the same place equal weights, in one target and "
        "between several",
        default=True,
    )
    eigenpairs: IntProperty(
        name="Eigenpairs",
        description="Number of surface harmonics behind the biharmonic distance; more are more exact and slower",
        min=10,
        soft_max=300,
        max=1000,
        default=100,
    )

    def draw_retarget(self, context):
        """Draw these options."""
        self.draw_options(
            self.layout,
            targets_of(context),
            (
                ("method", "mirror", "use_landmarks", "use_bone_map", "eigenpairs"),
                ("source_geometry", "target_geometry"),
                ("loose_parts", "parts_of_selection"),
                ("subset", "other_groups", "only_selected", "protected_group"),
                ("replace", "keep_unmapped", "mix_factor", "max_influences", "close_seams"),
            ),
        )

    def retarget_job(self, context, show_match: bool = False) -> RetargetJob:
        """Read and check what is selected."""
        source, targets = source_of(context), targets_of(context)
        choices = [
            TargetChoice(
                landmark_pairs(source, ob) if self.use_landmarks else (),
                bone_pairs(source, ob) if self.use_bone_map else None,
            )
            for ob in targets
        ]
        return RetargetJob(
            source,
            targets,
            choices,
            GeometryChoice(self.source_geometry == "EVALUATED", self.target_geometry == "EVALUATED"),
            RetargetSettings(
                method=self.method.lower(),
                eigenpairs=self.eigenpairs,
                mirror=self.mirror.lower(),
                close_seams=self.close_seams,
                keep_unmapped=self.keep_unmapped,
                parts=self.parts(),
                merge=self.merge(self.mix_factor),
            ),
            context.evaluated_depsgraph_get(),
            self.scope(),
            show_match,
        )
