"""What an HDF5 file may claim and hold, from either side."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import losbench as lb
from losbench.recording.frames.hdf5 import _check, open_hdf5

h5py = pytest.importorskip("h5py")
FRAMES = np.random.default_rng(5).integers(0, 900, (4, 6, 8)).astype(np.uint16)
MEBIBYTE = 2**20


def written(path, **datasets):
    with h5py.File(path, "w") as file:
        for name, data in datasets.items():
            file[name.replace("__", "/")] = data
    return path


def data_of(chunks, shape=(4, 6, 8), places=(), stored=10**9):
    """What `_check` asks of a data set whose chunks lie at (offset, size)."""

    def walk(look):
        for k, (offset, size) in enumerate(places):
            info = SimpleNamespace(byte_offset=offset, size=size, chunk_offset=(k, 0, 0))
            if look(info) is not None:
                return

    handle = SimpleNamespace(chunk_iter=walk, get_storage_size=lambda: stored)
    return SimpleNamespace(dtype=np.dtype("u2"), shape=shape, chunks=chunks, id=handle)


@pytest.mark.parametrize(
    ("place", "damaged"),
    [
        ((0, 900), False),
        ((100, 900), False),
        ((101, 900), True),
        ((-1, 900), True),
        ((2000, 5), True),
        ((0, 5), False),
        ((0, 4), True),
        ((0, 0), True),
    ],
)
def test_a_chunk_lies_within_its_file_and_is_more_than_a_checksum(tmp_path, place, damaged):
    path = tmp_path / "a.h5"
    path.write_bytes(bytes(1000))
    data = data_of((1, 6, 8), places=[(0, 96), place, (0, 0)] if damaged else [(0, 96), place])
    if damaged:
        with pytest.raises(lb.UnreadableFrame, match=r"chunk \(1, 0, 0\) of a is damaged"):
            _check(path, "a", data)
    else:
        _check(path, "a", data)


@pytest.mark.parametrize(
    ("chunks", "shape", "stored", "refused"),
    [
        ((1, 4096, 8192), (1, 4096, 8192), 10**9, None),  # 64 MiB
        ((1, 4096, 8193), (1, 4096, 8193), 10**9, "a.h5"),
        ((2, 4096, 8192), (2, 4096, 8192), 10**9, "a.h5"),
        (None, (9, 4096, 8192), 10**9, None),
        (None, (9, 4096, 8193), 10**9, "a.h5"),
        ((1, 64, 64), (1, 4096, 8193), 10**9, "a.h5"),
        (None, (20, 4096, 8192), 2 * MEBIBYTE, None),
        (None, (40, 4096, 8192), 2 * MEBIBYTE, "b of a.h5"),
    ],
)
def test_chunk_frame_and_stack_claim_no_more_than_files_can_hold(
    tmp_path, chunks, shape, stored, refused
):
    """64 MiB, or 1100 times what is stored."""
    path = tmp_path / "a.h5"
    path.write_bytes(bytes(1000))
    data = data_of(chunks, shape, stored=stored)
    if refused is None:
        _check(path, "b", data)
    else:
        with pytest.raises(lb.UnreadableFrame, match=f"^{refused} cannot be read"):
            _check(path, "b", data)


def test_only_numbers_in_three_or_four_dimensions_are_stacks(tmp_path):
    path = written(
        tmp_path / "a.h5",
        stack=FRAMES,
        image=FRAMES[0],
        five=FRAMES[None, None],
        empty=FRAMES[:0],
        words=np.full((2, 3, 4), b"a"),
        truth=FRAMES > 3,
    )
    found = open_hdf5(path, None)
    assert (found.source.dataset, found.source.n_frames) == ("stack", 4)
    for kind in ("i4", "f4", "f8"):
        path = written(tmp_path / f"{kind}.h5", group__deep__stack=FRAMES.astype(kind))
        assert open_hdf5(path, None).source.dataset == "group/deep/stack"
        np.testing.assert_array_equal(lb.open_frames(path).read(0, 4), FRAMES)
    colour = written(tmp_path / "colour.h5", a=np.repeat(FRAMES[..., None], 3, axis=-1))
    np.testing.assert_array_equal(lb.open_frames(colour).read(1, 3), FRAMES[1:3])


def test_a_stack_is_named_with_or_without_its_root(tmp_path):
    path = written(tmp_path / "a.h5", one__data=FRAMES, two__data=FRAMES + 1)
    for name in ("two/data", "/two/data"):
        np.testing.assert_array_equal(lb.open_frames(path, dataset=name).read(0, 4), FRAMES + 1)
    with pytest.raises(ValueError, match=r"got one/data \(4, 6, 8\), two/data \(4, 6, 8\)$"):
        lb.open_frames(path)
    with pytest.raises(ValueError, match="that is one/data, two/data, got 'three'"):
        lb.open_frames(path, dataset="three")


def test_eight_stacks_are_listed(tmp_path):
    path = written(tmp_path / "a.h5", **{f"s{k}": FRAMES for k in range(9)})
    for options in ({}, {"dataset": "none"}):
        with pytest.raises(ValueError, match="s7") as told:
            lb.open_frames(path, **options)
        assert "s8" not in str(told.value) and all(f"s{k}" in str(told.value) for k in range(8))
    none = written(tmp_path / "none.h5", image=FRAMES[0])
    for options in ({}, {"dataset": "image"}):
        with pytest.raises(ValueError, match="none"):
            lb.open_frames(none, **options)


def test_frames_of_a_chunk_come_one_by_one_or_together(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("a", data=FRAMES, chunks=(3, 6, 8), compression="gzip")
    frames = lb.open_frames(tmp_path / "a.h5")
    source = frames.source
    for k in range(4):
        np.testing.assert_array_equal(source.frame(k), FRAMES[k])
        assert source.label(k) == f"frame {k} of a.h5"
    np.testing.assert_array_equal(source.block(1, 4), FRAMES[1:4])
    assert frames.name == "a.h5" and source.path == Path(tmp_path / "a.h5")
