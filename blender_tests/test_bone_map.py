# SPDX-License-Identifier: GPL-3.0-or-later
"""The bone list: filled, changed by hand, used, refused with the bone's name."""

import bpy
import characters as c
import numpy as np
import pytest
from layouts import Layout, draw

NAMES = ("lower", "middle", "upper")
OTHER = {"lower": "root", "middle": "belly", "upper": "crown"}


def pair(rename=None, bones=None):
    """The source tube and a target tube with an armature of its own."""
    source, _ = c.source_tube()
    target = c.target_tube()
    rename = rename or {}
    bones = bones or c.tube_bones()
    own = c.armature("Own", [(rename.get(n, n), p and rename.get(p, p), h, t) for n, p, h, t in bones])
    c.deform(target, own)
    c.activate(source, target)
    return source, target, own


def rows(ob):
    return [(row.source, row.target, row.how) for row in ob.dermis_retarget.bone_map]


def test_filled_by_name():
    _, target, _ = pair()
    assert bpy.ops.dermis.map_bones() == {"FINISHED"}
    assert rows(target) == [(name, name, "NAME") for name in NAMES]


def test_filled_by_structure_and_used():
    source, target, _ = pair(OTHER)
    bpy.ops.dermis.map_bones()
    assert rows(target) == [(name, OTHER[name], "STRUCTURE") for name in NAMES]
    assert c.retarget(source, target) == {"FINISHED"}
    weights = c.dense(target, list(OTHER.values()))
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-6)
    heights = np.array([v.co.z for v in target.data.vertices])
    assert (weights[heights < 0.5].argmax(axis=1) == 0).all()
    assert (weights[heights > 2.5].argmax(axis=1) == 2).all()
    assert "3 mapped by structure" in target.dermis_retarget.result


def test_without_a_list_bones_are_mapped_with_each_run():
    source, target, _ = pair(OTHER)
    c.retarget(source, target)
    assert "3 mapped by structure" in target.dermis_retarget.result
    assert {g.name for g in target.vertex_groups} == set(OTHER.values())


def test_changed_by_hand():
    source, target, _ = pair()
    bpy.ops.dermis.map_bones()
    target.dermis_retarget.bone_map[2].target = "middle"
    assert rows(target)[2] == ("upper", "middle", "USER")
    c.activate(source, target)
    bpy.ops.ed.undo_push(message="Before")
    assert bpy.ops.dermis.retarget_weights("EXEC_DEFAULT", True) == {"FINISHED"}
    target = bpy.data.objects["Target"]
    assert "2 mapped by name, 1 mapped by hand" in target.dermis_retarget.result
    weights = c.dense(target, NAMES)
    assert weights[:, 2].max() == 0
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-6)
    bpy.ops.ed.undo()
    assert len(bpy.data.objects["Target"].vertex_groups) == 0
    assert len(rows(bpy.data.objects["Target"])) == 3
    c.retarget(bpy.data.objects["Source"], bpy.data.objects["Target"], use_bone_map=False)
    assert c.dense(bpy.data.objects["Target"], NAMES)[:, 2].max() > 0.9


def test_split_over_a_chain():
    """The source's middle bone over two bones of the target."""
    bones = [("lower", None, (0, 0, 0), (0, 0, 1)), ("middle", "lower", (0, 0, 1), (0, 0, 1.5)),
             ("twist", "middle", (0, 0, 1.5), (0, 0, 2)), ("upper", "twist", (0, 0, 2), (0, 0, 3))]  # fmt: skip
    source, target, _ = pair(bones=bones)
    bpy.ops.dermis.map_bones()
    kept = target.dermis_retarget
    kept.active_bone_pair = next(i for i, row in enumerate(kept.bone_map) if row.source == "middle")
    if not any(row.target == "twist" for row in kept.bone_map):
        assert bpy.ops.dermis.bone_map_add() == {"FINISHED"}
        kept.bone_map[kept.active_bone_pair].target = "twist"
    assert [row[:2] for row in rows(target) if row[0] == "middle"] == [("middle", "middle"), ("middle", "twist")]
    c.retarget(source, target)
    weights = c.dense(target, [name for name, *_ in bones])
    heights = np.array([v.co.z for v in target.data.vertices])
    assert (weights[(heights > 1.1) & (heights < 1.3)].argmax(axis=1) == 1).all()
    assert (weights[(heights > 1.7) & (heights < 1.9)].argmax(axis=1) == 2).all()
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-6)


def test_bone_without_a_target_gives_its_weight_to_its_ancestor():
    source, target, _ = pair()
    bpy.ops.dermis.map_bones()
    target.dermis_retarget.active_bone_pair = 2
    bpy.ops.dermis.bone_map_remove()
    assert rows(target)[2][:2] == ("upper", "")
    c.retarget(source, target)
    weights = c.dense(target, NAMES)
    heights = np.array([v.co.z for v in target.data.vertices])
    assert (weights[heights > 2.5, 1] > 0.99).all()
    assert "gave their weight on: 'upper' to 'middle'" in target.dermis_retarget.result


def test_fewer_bones_in_the_target():
    source, target, _ = pair(bones=c.tube_bones()[:2])
    c.retarget(source, target)
    np.testing.assert_allclose(c.dense(target, NAMES[:2]).sum(axis=1), 1, atol=1e-6)
    assert "'upper' to 'middle'" in target.dermis_retarget.result or "mapped" in target.dermis_retarget.result


def test_rows_are_removed_and_the_list_cleared():
    _, target, _ = pair()
    bpy.ops.dermis.map_bones()
    target.dermis_retarget.active_bone_pair = 1
    bpy.ops.dermis.bone_map_add()
    assert [row[0] for row in rows(target)] == ["lower", "middle", "middle", "upper"]
    assert target.dermis_retarget.active_bone_pair == 2
    bpy.ops.dermis.bone_map_remove()
    assert [row[0] for row in rows(target)] == list(NAMES)
    bpy.ops.dermis.bone_map_clear()
    assert rows(target) == []
    with pytest.raises(RuntimeError, match="'Target' has no bone list: map the bones first"):
        bpy.ops.dermis.bone_map_clear()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("middle", "gone"), "pairs 'middle' with 'gone', but 'Own' has no deforming bone 'gone'"),
        (("lower", "middle"), ""),
    ],
)
def test_bones_renamed_or_removed_since(change, message):
    source, target, own = pair()
    bpy.ops.dermis.map_bones()
    row = next(row for row in target.dermis_retarget.bone_map if row.source == change[0])
    row.target = change[1]
    before = c.state(target)
    if message:
        with pytest.raises(RuntimeError, match=message + r".*Nothing was changed\."):
            c.retarget(source, target)
        assert c.state(target) == before
    else:
        own.data.bones["middle"].use_deform = False
        with pytest.raises(RuntimeError, match=r"'Own' has no deforming bone 'middle'.*Nothing was changed\."):
            c.retarget(source, target)


def test_list_of_another_armature():
    _, target, _ = pair()
    bpy.ops.dermis.map_bones()
    second, _ = c.source_tube("Second")
    with pytest.raises(RuntimeError, match="The bone list of 'Target' belongs to 'SourceRig', not to 'SecondRig'"):
        c.retarget(second, target)
    assert c.retarget(second, target, use_bone_map=False) == {"FINISHED"}


def test_source_without_an_armature():
    source = c.target_tube("Source")
    target = c.target_tube()
    c.activate(source, target)
    with pytest.raises(RuntimeError, match="The source 'Source' has no armature"):
        bpy.ops.dermis.map_bones()


def test_one_target_only():
    source, target, _ = pair()
    c.activate(source, target, c.target_tube("Other"))
    with pytest.raises(RuntimeError, match="Select one target only: each target has a bone list of its own"):
        bpy.ops.dermis.map_bones()


def test_undo():
    pair()
    bpy.ops.ed.undo_push(message="Before")
    bpy.ops.dermis.map_bones("EXEC_DEFAULT", True)
    assert len(rows(bpy.data.objects["Target"])) == 3
    bpy.ops.ed.undo()
    assert rows(bpy.data.objects["Target"]) == []


def test_list_is_saved_with_the_file(tmp_path):
    pair()
    bpy.ops.dermis.map_bones()
    path = str(tmp_path / "scene.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    target = bpy.data.objects["Target"]
    assert rows(target) == [(name, name, "NAME") for name in NAMES]
    assert c.retarget(bpy.data.objects["Source"], target) == {"FINISHED"}


def test_panel():
    source, target, own = pair()
    assert draw("DERMIS_PT_bone_map") == ["None: mapped with each retargeting", "dermis.map_bones"]
    bpy.ops.dermis.map_bones()
    shown = draw("DERMIS_PT_bone_map")
    assert shown[0] == "DERMIS_UL_bone_map"
    assert shown[-3:] == ["target", "Both bones have one name", "dermis.map_bones"]
    kept = target.dermis_retarget
    drawn = []

    class Row(Layout):
        def label(self, text="", icon="NONE"):
            super().label(text, icon)
            drawn.append((text, icon))

        def split(self, **_):
            return self

    kind = bpy.types.DERMIS_UL_bone_map
    kind.draw_item(None, bpy.context, Row([]), kept, kept.bone_map[0], 0, kept, "", 0, 0)
    assert drawn == [("lower", "CHECKMARK"), ("lower", "NONE")]
    kept.bone_map[0].target = "middle"
    assert "Chosen by hand" in draw("DERMIS_PT_bone_map")
    kept.bone_map[0].target = ""
    assert "Weight goes to the nearest mapped ancestor" in draw("DERMIS_PT_bone_map")
    drawn.clear()
    kind.draw_item(None, bpy.context, Row([]), kept, kept.bone_map[0], 0, kept, "", 0, 0)
    assert drawn == [("lower", "TRIA_UP"), ("", "NONE")]
    c.activate(source, target, own)
    bpy.data.objects.remove(bpy.data.objects["SourceRig"])
    assert any(text.startswith("This list belongs to") for text in draw("DERMIS_PT_bone_map"))


def test_bone_that_only_the_target_has_takes_its_share():
    """By weights from the skeleton alone, unless the list of bones is the user's."""
    source, _ = c.source_tube()
    target = c.target_tube()
    side = ("side", "middle", (0.1, 0, 1.5), (0.55, 0, 1.5))
    c.deform(target, c.armature("TargetRig", [*c.tube_bones(), side]))
    assert c.retarget(source, target) == {"FINISHED"}
    names = ["lower", "middle", "upper", "side"]
    weights = c.dense(target, names)
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-5)
    places = np.array([vertex.co for vertex in target.data.vertices])
    near = np.linalg.norm(places - (0.6, 0, 1.5), axis=1) < 0.25
    assert weights[near, 3].mean() > 0.3
    assert weights[np.abs(places[:, 2] - 1.5) > 1, 3].mean() < 0.02
    assert "weighted by their place: 'side'" in target.dermis_retarget.result
    c.activate(source, target)
    assert bpy.ops.dermis.map_bones() == {"FINISHED"}
    assert c.retarget(source, target) == {"FINISHED"}
    assert c.dense(target, names)[:, 3].max() == 0
