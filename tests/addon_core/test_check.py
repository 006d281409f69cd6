# SPDX-License-Identifier: GPL-3.0-or-later
"""The whole check: categories, loose parts, report, and dry runs."""

import json
from dataclasses import replace

import numpy as np
import pytest

from .conftest import chain, dense, entries, strip

native = pytest.importorskip("dermis_native")

from addon.core.character import BoneWeights, Surface  # noqa: E402
from addon.core.check import Checked, CheckSettings, check, summary  # noqa: E402
from addon.core.check_parts import loose_parts  # noqa: E402
from addon.core.check_task import CheckTask, RetargetCheckTask, resulting_weights  # noqa: E402
from addon.core.errors import InputError  # noqa: E402
from addon.core.merge import MergeSettings  # noqa: E402
from addon.core.retarget import RetargetSettings  # noqa: E402
from addon.core.task import RetargetTask  # noqa: E402

from .test_check_stretch import smooth_weights  # noqa: E402


def good(rows=13):
    surface = strip(3, rows)
    return Checked("Body", "Rig", surface, chain("a", "b", "c"), smooth_weights(surface, 1.5)[0])


def with_parts(rows=13):
    """The strip and two small triangles beside it, the second with one bone for all its vertices."""
    body = good(rows)
    count = len(body.surface.vertices)
    extra = np.array([(3, 0, 0.2), (3.1, 0, 0.2), (3, 0, 0.3), (4, 0, 2.0), (4.1, 0, 2.0), (4, 0, 2.1)])
    surface = Surface(
        np.vstack([body.surface.vertices, extra]),
        np.append(body.surface.loop_counts, [3, 3]).astype(np.int32),
        np.append(body.surface.loop_indices, np.arange(count, count + 6)).astype(np.int32),
    )
    more = entries(*((count + i, i if i < 3 else 2, 1.0) for i in range(6)))
    columns = ("vertex", "bone", "value")
    weights = BoneWeights(*(np.concatenate([getattr(body.weights, name), getattr(more, name)]) for name in columns))
    return replace(body, surface=surface, weights=weights)


def test_nothing_to_look_at():
    report = check(good(), CheckSettings())
    assert report.vertices == {}
    assert report.faults == 0
    assert report.lines()[0] == "'Body' with 'Rig': 26 vertices, nothing to look at."
    assert summary([report]) == "Checked 'Body': nothing to look at."
    assert "sides were not looked at" in report.notes[0]


def test_known_faults_are_found_where_they_are():
    body = good()
    dense_weights = dense(body.weights, 26, 3)
    dense_weights[3] = 0
    dense_weights[8] *= 0.5
    vertex, bone = np.nonzero(dense_weights)
    wrong = BoneWeights(vertex.astype(np.int32), bone.astype(np.int32), dense_weights[vertex, bone].astype(np.float32))
    report = check(replace(body, weights=wrong), CheckSettings(max_influences=2))
    assert report.vertices["unweighted"].tolist() == [3]
    assert report.vertices["totals"].tolist() == [8]
    assert len(report.vertices["influences"]) == 25
    assert 3 in report.vertices["stretch"]
    assert report.faults == 26
    assert any("edges stretch over 2 times when a joint turns by 45\N{DEGREE SIGN}" in note for note in report.notes)
    assert "1 vertex without weights." in report.lines()
    assert summary([report]).startswith("Checked 'Body': 26 vertices to look at: 1 without weights, 1 with a total")
    assert json.loads(json.dumps(report.as_dict()))["categories"]["unweighted"] == [3]


def test_loose_parts():
    checked = with_parts()
    parts = loose_parts("Body", checked.surface, checked.weights)
    assert parts.sizes.tolist() == [26, 3, 3]
    assert parts.rigid.tolist() == [False, False, True]
    assert parts.part[[0, 26, 29]].tolist() == [0, 1, 2]
    report = check(checked, CheckSettings())
    assert report.vertices["parts"].tolist() == list(range(26, 32))
    assert "2 loose parts beside the largest (3, 3 vertices): 1 moving as one, 1 bending." in report.notes


def test_bones_and_groups_that_miss_each_other():
    body = good()
    light = replace(body, weights=body.weights.where(body.weights.bone != 1), boneless_groups=("Mask",))
    notes = check(light, CheckSettings()).notes
    assert notes[:2] == ("1 bone without any weight: 'b'.", "1 group without a deforming bone: 'Mask'.")


def test_a_part_without_weights_is_rigid_and_one_with_some_is_not():
    checked = with_parts()
    bare = checked.weights.where(checked.weights.vertex < 26)
    assert loose_parts("Body", checked.surface, bare).rigid.tolist() == [False, True, True]
    some = checked.weights.where(checked.weights.vertex != 30)
    assert loose_parts("Body", checked.surface, some).rigid.tolist() == [False, False, False]


def test_surface_that_cannot_be_used():
    body = good()
    bent = replace(body.surface, vertices=body.surface.vertices.copy())
    bent.vertices[4, 1] = np.nan
    with pytest.raises(InputError, match="not finite at 1 vertex, the first is vertex 4"):
        check(replace(body, surface=bent), CheckSettings())


def test_seam_between_two_meshes():
    low = good()
    high = replace(low, name="High", surface=replace(low.surface, vertices=np.add(low.surface.vertices, (0, 0, 3))))
    reports = CheckTask([low, high], CheckSettings()).work()
    assert [report.vertices["seams"].tolist() for report in reports] == [[24, 25], [0, 1]]
    same = replace(high, weights=replace(low.weights, vertex=25 - low.weights.vertex))
    assert "seams" not in CheckTask([low, same], CheckSettings()).work()[0].vertices
    assert "seams" not in CheckTask([low], CheckSettings()).work()[0].vertices


def test_task_checks_each_mesh_and_can_be_cancelled():
    task = CheckTask([good(), replace(good(), name="Other")], CheckSettings())
    task.start()
    assert [report.name for report in task.result()] == ["Body", "Other"]
    assert task.fraction == 1
    cancelled = CheckTask([good()], CheckSettings())
    cancelled.cancel()
    cancelled.start()
    with pytest.raises(native.Cancelled):
        cancelled.result()


def dry_run(source, target, **merge):
    settings = RetargetSettings(merge=MergeSettings(**merge))
    return RetargetCheckTask(source, [target], RetargetTask(source, [target], settings), CheckSettings())


def test_dry_run_looks_at_what_would_be_written(source, target):
    task = dry_run(source, target)
    task.start()
    (report,) = task.result()
    assert "unweighted" not in report.vertices
    assert report.name == "New"
    assert "Bones of 'OldRig' mapped to 'NewRig': 3 by name." in report.notes
    assert task.fraction == pytest.approx(1)
    some = replace(target, only_vertices=np.arange(16) < 10)
    task = dry_run(source, some)
    task.start()
    assert task.result()[0].vertices["unweighted"].tolist() == list(range(10, 16))


def test_dry_run_can_be_cancelled(source, target):
    task = dry_run(source, target)
    task.cancel()
    task.start()
    with pytest.raises(native.Cancelled):
        task.result()


def test_resulting_weights_keep_what_is_not_written(source, target):
    old = entries((0, 0, 0.5), (0, 1, 0.5), (15, 2, 1.0))
    locked = replace(target, existing=old, locked=np.array([False, True, False]), only_vertices=np.arange(16) < 15)
    task = RetargetTask(source, [locked], RetargetSettings())
    result = task.work()[0]
    after = dense(resulting_weights(locked, result), 16, 3)
    assert after[0, 1] == 0.5
    assert after[15].tolist() == [0, 0, 1]
    np.testing.assert_allclose(after.sum(axis=1), 1, atol=1e-6)
