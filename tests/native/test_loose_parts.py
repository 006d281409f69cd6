"""What becomes of loose parts where the caller chooses, in a retargeting and in a bind, and what is protected."""

from dataclasses import replace
from functools import cache

import characters
import makehuman
import numpy as np
import pytest
from dermis_native import SkinWeights, TriangleMesh, bind_weights, retarget_weights
from surfaces import sphere

TRIANGLES = 4000
BALL, BALLS = 42, 2


@cache
def child():
    return characters.remeshed(characters.body("child", **makehuman.CHILD), TRIANGLES)


@cache
def man():
    return characters.remeshed(characters.body("male", **makehuman.YOUNG_MALE), TRIANGLES)


@cache
def dressed():
    """The child with a ball around each elbow."""
    body = child()
    ball, faces = sphere(1)
    vertices, triangles = [body.vertices], [body.triangles]
    for name in ("lowerarm_l", "lowerarm_r"):
        bone = body.bone_names.index(name)
        triangles.append(faces + sum(len(part) for part in vertices))
        vertices.append(body.heads[bone] + 0.35 * np.linalg.norm(body.tails[bone] - body.heads[bone]) * ball)
    vertices, triangles = np.concatenate(vertices), np.concatenate(triangles)
    return replace(
        body,
        vertices=vertices,
        loop_counts=np.full(len(triangles), 3, np.int64),
        loop_indices=triangles.ravel().astype(np.int64),
        weights=np.zeros((len(vertices), len(body.bone_names)), np.float32),
    )


def balls(dense):
    """The rows of each ball."""
    assert len(dense) == len(child().vertices) + BALLS * BALL
    return np.split(dense[-BALLS * BALL :], BALLS)


def retargeted(**options):
    return retarget_weights(
        characters.mesh_of(man()),
        characters.weights_of(man()),
        characters.mesh_of(dressed()),
        source_skeleton=characters.skeleton_of(man()),
        target_skeleton=characters.skeleton_of(dressed()),
        **options,
    )


def bound(**options):
    skeleton = characters.skeleton_of(dressed())
    return bind_weights(characters.mesh_of(dressed()), skeleton, **options).to_dense()


def spread(rows):
    """Largest L1 difference of a row to the first."""
    return np.abs(rows - rows[0]).sum(axis=1).max()


def below(dense):
    """What the nearest points of the body have, for the vertices of both balls."""
    body = replace(child(), weights=dense[: -BALLS * BALL])
    return makehuman.interpolated_weights(body, dressed().vertices[-BALLS * BALL :])


def test_rigid_parts_have_one_row_and_the_body_is_left_alone():
    result, auto = retargeted(parts="rigid"), retargeted()
    assert result.body == 0
    assert result.part_policies == ["match", "rigid", "rigid"]
    assert (np.bincount(result.part) == [len(child().vertices), BALL, BALL]).all()
    dense = result.weights.to_dense()
    assert all(spread(rows) == 0 for rows in balls(dense))
    assert (dense[: -BALLS * BALL] == auto.weights.to_dense()[: -BALLS * BALL]).all()


def test_parts_on_the_surface_follow_it_vertex_by_vertex():
    result = retargeted(parts="surface")
    assert result.part_policies == ["match", "surface", "surface"]
    dense = result.weights.to_dense()
    assert np.abs(dense[-BALLS * BALL :] - below(dense)).sum(axis=1).mean() < 0.01
    assert all(spread(rows) > 0.1 for rows in balls(dense))


def test_a_choice_for_each_component():
    result = retargeted(parts=["auto", "rigid", "surface"])
    assert result.part_policies == ["match", "rigid", "surface"]
    first, second = balls(result.weights.to_dense())
    assert spread(first) == 0 < spread(second)
    whole = retargeted(parts=("rigid", "auto", "auto")).weights.to_dense()
    assert spread(whole[: -BALLS * BALL]) == 0
    assert np.abs(whole.sum(axis=1) - 1).max() <= 1e-6


def test_matched_parts_are_matched_or_follow():
    result = retargeted(parts="match")
    assert set(result.part_policies[1:]) <= {"match", "surface"}
    assert np.abs(result.weights.to_dense().sum(axis=1) - 1).max() <= 1e-6


def test_wrong_choices_are_named():
    with pytest.raises(ValueError, match='parts must be one of auto, rigid, surface, match, got "soft"'):
        retargeted(parts="soft")
    with pytest.raises(ValueError, match=r"parts\[1\] must be one of auto, rigid, surface, match, got \"own\""):
        retargeted(parts=["auto", "own", "auto"])
    with pytest.raises(ValueError, match="given for 2 components, but the mesh has 3"):
        retargeted(parts=["auto", "rigid"])
    with pytest.raises(ValueError, match="parts must be a name or a sequence of names"):
        retargeted(parts=7)
    with pytest.raises(ValueError, match='by method "auto" alone'):
        retargeted(parts="rigid", method="paper")
    with pytest.raises(ValueError, match="given for 1 components, but the mesh has 3"):
        bound(parts=["own"])
    with pytest.raises(ValueError, match='by method "volumetric" alone'):
        bound(parts="rigid", method="paper")


def test_components_that_a_seam_joins_are_one_part():
    # The two ends of a tube are cut off from its middle, but stand where they stood.
    it = dressed()
    cut = np.flatnonzero((it.vertices[it.triangles][:, :, 2] > 0.9 * it.vertices[:, 2].max()).all(axis=1))
    triangles = it.triangles.copy()
    copied, corners = np.unique(triangles[cut], return_inverse=True)
    triangles[cut] = corners.reshape(-1, 3) + len(it.vertices)
    mesh = TriangleMesh(np.concatenate([it.vertices, it.vertices[copied]]), triangles)
    count = int(mesh.components.max()) + 1
    head, trunk = mesh.components[len(it.vertices)], mesh.components[it.triangles[0, 0]]
    assert head != trunk
    parts = ["auto"] * count
    parts[trunk], parts[head] = "match", "rigid"
    skeletons = {
        "source_skeleton": characters.skeleton_of(man()),
        "target_skeleton": characters.skeleton_of(it),
    }
    source = characters.mesh_of(man()), characters.weights_of(man())
    with pytest.raises(ValueError, match="are one part, but are to be treated in two ways"):
        retarget_weights(*source, mesh, parts=parts, **skeletons)
    parts[head] = "auto"
    found = retarget_weights(*source, mesh, parts=parts, **skeletons)
    assert found.part[len(it.vertices)] == found.body


def test_loose_parts_of_a_bind():
    body = slice(None, -BALLS * BALL)
    own, rigid, surface = (bound(parts=name) for name in ("own", "rigid", "surface"))
    assert (own[body] == rigid[body]).all()
    assert (own[body] == surface[body]).all()
    assert all(spread(rows) == 0 for rows in balls(rigid))
    assert all(spread(rows) > 0.1 for rows in balls(own))
    assert np.abs(surface[-BALLS * BALL :] - below(surface)).sum(axis=1).mean() < 0.01
    mixed = balls(bound(parts=["auto", "rigid", "own"]))
    assert (mixed[0] == balls(rigid)[0]).all()
    assert (mixed[1] == balls(own)[1]).all()
    for dense in (own, rigid, surface, bound(parts=["surface"] * 3), bound(parts=["rigid"] * 3)):
        assert np.abs(dense.sum(axis=1) - 1).max() <= 1e-6


def test_protected_vertices_keep_their_rows_bit_for_bit():
    it = child()
    mesh, skeleton = characters.mesh_of(it), characters.skeleton_of(it)
    random = np.random.default_rng(2)
    old = (random.random(it.weights.shape) * (random.random(it.weights.shape) < 0.1)).astype(np.float32)
    protected = random.random(len(it.vertices)) < 0.3
    free = bind_weights(mesh, skeleton, max_influences=2).to_dense()
    for chosen in (protected, np.flatnonzero(protected)):
        kept = bind_weights(
            mesh, skeleton, max_influences=2, protected=chosen, weights=SkinWeights.from_dense(old)
        ).to_dense()
        assert (kept[protected] == old[protected]).all()
        assert (kept[~protected] == free[~protected]).all()


def test_wrong_protection_is_named():
    it = child()
    mesh, skeleton, weights = characters.mesh_of(it), characters.skeleton_of(it), characters.weights_of(it)
    count = len(it.vertices)
    with pytest.raises(ValueError, match="given together or not at all"):
        bind_weights(mesh, skeleton, protected=[0])
    with pytest.raises(ValueError, match=rf"protected\[1\] is {count}, but there are {count} vertices"):
        bind_weights(mesh, skeleton, protected=[0, count], weights=weights)
    few = SkinWeights.from_dense(np.ones((count - 1, len(skeleton))))
    with pytest.raises(ValueError, match=f"protected weights are of {count - 1} vertices, but there are {count}"):
        bind_weights(mesh, skeleton, protected=[0], weights=few)
