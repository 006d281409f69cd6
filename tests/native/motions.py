"""Motions of a body in the game-engine rig with many joints at work: a walk, deep poses, recorded clips."""

from pathlib import Path

import numpy as np
from deformation import turned
from dermis_native import Skeleton, SkinWeights, TriangleMesh

CLIPS = Path(__file__).resolve().parents[3] / "shared" / "data" / "mh_default.npz"

# Degrees about x (forwards is negative for a leg), y and z of the rest pose.
DEEP_POSES = {
    "squat": {
        "pelvis": (35, 0, 0), "thigh_l": (-125, 0, -8), "thigh_r": (-125, 0, 8), "calf_l": (130, 0, 0),
        "calf_r": (130, 0, 0), "spine_02": (-10, 0, 0), "upperarm_l": (-60, 0, 0), "upperarm_r": (-60, 0, 0),
    },
    "lunge": {
        "thigh_l": (-85, 0, 0), "calf_l": (90, 0, 0), "thigh_r": (35, 0, 0), "calf_r": (45, 0, 0),
        "spine_01": (0, 0, 15), "spine_02": (10, 0, 15), "neck_01": (-15, 0, 0), "lowerarm_l": (-40, 0, 0),
    },
    "reach": {
        "spine_01": (15, 0, 10), "spine_03": (15, 0, 15), "upperarm_r": (-80, 0, 20), "lowerarm_r": (-30, 0, 0),
        "hand_r": (0, 40, 0), "head": (-20, 0, 20), "thigh_l": (-20, 0, 0), "calf_l": (30, 0, 0),
    },
    "sit": {
        "thigh_l": (-90, 0, 0), "thigh_r": (-90, 0, 0), "calf_l": (85, 0, 0), "calf_r": (95, 0, 0),
        "foot_l": (15, 0, 0), "spine_02": (12, 0, 0), "head": (15, 0, -30), "lowerarm_l": (-70, 0, 0),
    },
}  # fmt: skip


def posed(skeleton, degrees):
    """Transforms of bones turned by degrees about the axes of the rest pose."""
    return turned(skeleton, {bone: np.radians(angles) for bone, angles in degrees.items()})


def walk(skeleton, frames):
    """Transforms (frames,B,4,4) of one cycle of a walk: legs, arms, spine and head swing."""
    poses = []
    for phase in np.arange(frames) * (2 * np.pi / frames):
        swing, lift = np.sin(phase), np.cos(phase)
        legs = {
            f"{bone}_{side}": (angle, 0, 0)
            for side, sign in (("l", 1), ("r", -1))
            for bone, angle in (
                ("thigh", -28 * sign * swing - 5),
                ("calf", 32 + 28 * np.sin(phase + np.pi * (sign < 0) + 0.9)),
                ("foot", 12 * sign * lift),
                ("upperarm", 30 * sign * swing),
                ("lowerarm", -22 + 14 * sign * swing),
            )
        }
        poses.append(posed(skeleton, legs | {"spine_01": (3, 0, 6 * swing), "spine_03": (2, 4 * lift, -9 * swing)}))
    return np.array(poses)


def recorded(clip):
    """Mesh, skeleton, weights and transforms (T,B,4,4) of a recorded clip, None where there is none."""
    if not CLIPS.is_file():
        return None
    with np.load(CLIPS) as data:
        mesh = TriangleMesh.from_polygons(data["verts"], data["loop_counts"], data["loop_indices"])
        skeleton = Skeleton(data["heads"], data["tails"], data["parents"], data["bone_names"].tolist())
        entries = (data["w_vert"], data["w_bone"], data["w_val"])
        weights = SkinWeights.from_triplets(*entries, len(data["verts"]), len(skeleton))
        poses = np.tile(np.eye(4), (*data[f"anim_{clip}"].shape[:2], 1, 1))
        poses[:, :, :3] = data[f"anim_{clip}"]
    return mesh, skeleton, weights, poses
