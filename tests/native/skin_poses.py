"""The poses by which skins are compared: a cylinder bent and twisted, a MakeHuman body joint by joint."""

import numpy as np
from deformation import capped_cylinder, turned
from dermis_native import Skeleton, SkinWeights, TriangleMesh

# Pose, and the least joint volume that the skin keeps, as a share of rest; plain skinning's beside it.
CYLINDER = {
    ("twist", 60): (0.98, 0.88),
    ("twist", 90): (0.98, 0.75),
    ("twist", 150): (0.96, 0.53),
    ("bend", 60): (0.97, 0.94),
    ("bend", 90): (0.96, 0.88),
    ("bend", 120): (0.95, 0.81),
}


def cylinder():
    """Mesh, skeleton and weights of a capped cylinder of radius 1 whose weights blend over |x| <= 1.2."""
    vertices, triangles = capped_cylinder()
    share = np.clip((vertices[:, 0] + 1.2) / 2.4, 0, 1)
    share = share * share * (3 - 2 * share)
    skeleton = Skeleton([[-4.0, 0, 0], [0, 0, 0]], [[0.0, 0, 0], [4, 0, 0]], [-1, 0], ["first", "second"])
    return TriangleMesh(vertices, triangles), skeleton, SkinWeights.from_dense(np.stack([1 - share, share], axis=1))


def cylinder_pose(skeleton, kind, degrees):
    """Transforms of the cylinder's two bones."""
    axis = [1.0, 0, 0] if kind == "twist" else [0, 0, 1.0]
    return turned(skeleton, {"second": np.radians(degrees) * np.array(axis)})


def body_poses(skeleton):
    """Names and transforms of a body in the game-engine rig, one joint turned at a time."""
    bone = {name: i for i, name in enumerate(skeleton.names)}

    def direction(name):
        vector = skeleton.tails[bone[name]] - skeleton.heads[bone[name]]
        return vector / np.linalg.norm(vector)

    sideways = np.array([1.0, 0, 0])
    # The arm is bent by 43° at rest; it bends on in the same plane, to 120° in all.
    elbow = np.cross(direction("upperarm_l"), direction("lowerarm_l"))
    already = np.degrees(np.arcsin(np.linalg.norm(elbow)))
    elbow /= np.linalg.norm(elbow)
    shoulder = np.cross(direction("upperarm_l"), [0, 0, 1.0])
    shoulder /= np.linalg.norm(shoulder)
    turns = {
        "knee 120": ("calf_l", sideways, 120),
        "knee 90": ("calf_l", sideways, 90),
        "elbow 120": ("lowerarm_l", elbow, 120 - already),
        "forearm twist 120": ("lowerarm_l", direction("lowerarm_l"), 120),
        "hip 90": ("thigh_l", sideways, -90),
        "shoulder 60": ("upperarm_l", shoulder, 60),
        "wrist twist 90": ("hand_l", direction("hand_l"), 90),
        "spine 35": ("spine_02", sideways, 35),
    }
    return {name: turned(skeleton, {b: np.radians(angle) * axis}) for name, (b, axis, angle) in turns.items()}


FINGERS = ("index", "middle", "ring", "pinky")


def curled(skeleton, degrees, fingers=FINGERS, axis=None):
    """Transforms of the left hand with all three joints of fingers bent, by default about the line across its palm."""
    knuckle = {finger: skeleton.heads[list(skeleton.names).index(f"{finger}_01_l")] for finger in FINGERS}
    axis = np.asarray(knuckle["pinky"] - knuckle["index"] if axis is None else axis, float)
    turn = np.radians(degrees) * axis / np.linalg.norm(axis)
    return turned(skeleton, {f"{finger}_0{joint}_l": turn for finger in fingers for joint in (1, 2, 3)})
