# SPDX-License-Identifier: GPL-3.0-or-later
"""Point caches: their bytes by an independent reading, parts, and files that are none."""

import struct
from pathlib import Path

import numpy as np
import pytest

from addon.core.errors import InputError
from addon.core.frame_range import FrameList, FrameRange
from addon.core.point_cache import CacheFormat, CacheLayout, CacheWriter, join_caches, read_layout, read_sample

VERTICES = 7


def sample(frames: FrameRange, index: int) -> np.ndarray:
    frame, part = frames.place(index)
    return np.random.default_rng(round(1000 * (frame + part)) + 10**6).normal(size=(VERTICES, 3)).astype(np.float32)


def write(path: Path, kind: CacheFormat, frames: FrameRange, order: list[int] | None = None) -> Path:
    with CacheWriter(path, CacheLayout.of_range(kind, VERTICES, frames, 24.0)) as writer:
        for index in range(len(frames)) if order is None else order:
            writer.write(index, sample(frames, index))
    return path


def test_bytes_of_pc2(tmp_path: Path) -> None:
    frames = FrameRange(-1, 2, 2)
    data = write(tmp_path / "a.pc2", "PC2", frames).read_bytes()
    assert struct.unpack_from("<12siiffi", data) == (b"POINTCACHE2\0", 1, VERTICES, -1.0, 0.5, 7)
    numbers = struct.unpack_from(f"<{7 * VERTICES * 3}f", data, 32)
    np.testing.assert_array_equal(numbers, np.concatenate([sample(frames, i).ravel() for i in range(7)]))
    assert len(data) == 32 + 4 * len(numbers)


def test_bytes_of_mdd(tmp_path: Path) -> None:
    frames = FrameRange(12, 14)
    data = write(tmp_path / "a.mdd", "MDD", frames).read_bytes()
    assert struct.unpack_from(">2i", data) == (3, VERTICES)
    assert struct.unpack_from(">3f", data, 8) == pytest.approx((12 / 24, 13 / 24, 14 / 24))
    numbers = struct.unpack_from(f">{3 * VERTICES * 3}f", data, 20)
    np.testing.assert_array_equal(numbers, np.concatenate([sample(frames, i).ravel() for i in range(3)]))


@pytest.mark.parametrize("kind", ["PC2", "MDD"])
def test_reading_back(tmp_path: Path, kind: CacheFormat) -> None:
    frames = FrameRange(3, 5, 4)
    path = write(tmp_path / "a", kind, frames)
    layout = read_layout(path)
    assert (layout.format, layout.vertex_count, len(layout.times)) == (kind, VERTICES, 9)
    assert layout.total_bytes == path.stat().st_size
    for index in range(9):
        np.testing.assert_array_equal(read_sample(path, layout, index), sample(frames, index))


@pytest.mark.parametrize("kind", ["PC2", "MDD"])
@pytest.mark.parametrize("per_frame", [1, 3, 4])
def test_order_and_parts_do_not_matter(tmp_path: Path, kind: CacheFormat, per_frame: int) -> None:
    whole = FrameRange(1, 30, per_frame)
    expected = write(tmp_path / "whole", kind, whole).read_bytes()
    shuffled = np.random.default_rng(0).permutation(len(whole)).tolist()
    assert write(tmp_path / "shuffled", kind, whole, shuffled).read_bytes() == expected
    # Parts with subframes share the frame where they meet.
    cuts = [(21, 30), (1, 11), (11, 21)] if per_frame > 1 else [(22, 30), (1, 10), (11, 21)]
    parts = [write(tmp_path / f"{a}", kind, FrameRange(a, b, per_frame)) for a, b in cuts]
    join_caches(parts, tmp_path / "joined")
    assert (tmp_path / "joined").read_bytes() == expected


def test_parts_that_do_not_fit(tmp_path: Path) -> None:
    first = write(tmp_path / "first", "PC2", FrameRange(1, 5))
    gap = write(tmp_path / "gap", "PC2", FrameRange(7, 9))
    with pytest.raises(InputError, match="gap after 'first'"):
        join_caches([gap, first], tmp_path / "joined")
    with pytest.raises(InputError, match="another format"):
        join_caches([first, write(tmp_path / "mdd", "MDD", FrameRange(6, 9))], tmp_path / "joined")
    with pytest.raises(InputError, match="another step"):
        join_caches([first, write(tmp_path / "fine", "PC2", FrameRange(6, 9, 2))], tmp_path / "joined")
    other = write(tmp_path / "other", "PC2", FrameRange(5, 9))
    with other.open("r+b") as file:
        file.seek(40)
        file.write(b"abc")
    with pytest.raises(InputError, match="differ in a sample"):
        join_caches([first, other], tmp_path / "joined")
    with pytest.raises(InputError, match="no cache to join"):
        join_caches([], tmp_path / "joined")
    assert not (tmp_path / "joined").exists()


def test_files_that_are_no_caches(tmp_path: Path) -> None:
    path = tmp_path / "bad"
    for content in (b"", b"text", b"POINTCACHE2\0", struct.pack(">2i", 3, 5) + b"0" * 11):
        path.write_bytes(content)
        with pytest.raises(InputError, match="bad"):
            read_layout(path)
    whole = write(tmp_path / "whole", "PC2", FrameRange(1, 5)).read_bytes()
    path.write_bytes(whole[:-4])
    with pytest.raises(InputError, match="cut off"):
        read_layout(path)


def test_every_sample_must_be_written_and_fit(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"Sample 1 .* never written"):
        write(tmp_path / "a", "PC2", FrameRange(1, 3), [0, 2])
    layout = CacheLayout.of_range("PC2", VERTICES, FrameRange(1, 1), 24.0)
    with pytest.raises(InputError, match="3 vertices instead of 7"), CacheWriter(tmp_path / "b", layout) as writer:
        writer.write(0, np.zeros((3, 3), np.float32))


def test_frames() -> None:
    frames = FrameRange(-2, 1, 4)
    assert [frames.place(i) for i in (0, 1, 4, 12)] == [(-2, 0.0), (-2, 0.25), (-1, 0.0), (1, 0.0)]
    assert len(frames) == 13
    with pytest.raises(InputError, match="before the first"):
        FrameRange(3, 2)
    with pytest.raises(InputError, match="at least 1"):
        FrameRange(1, 2, 0)
    spread = FrameList.spread(FrameRange(1, 100), 4)
    assert spread.places == ((1, 0.0), (34, 0.0), (67, 0.0), (100, 0.0))
    assert len(FrameList.spread(FrameRange(1, 3), 10)) == 3
