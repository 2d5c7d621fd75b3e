"""Pages of a TIFF that are not plain: packed bits, strips at their limits, what is no page."""

import pickle
from pathlib import Path

import files_of_frames as write
import numpy as np
import pytest
import tifffile

import losbench as lb
from losbench.recording.frames.tiff import Pages, _directories, facts

RNG = np.random.default_rng(29)


def packed(frame, bits):
    """High bits first, rows at whole bytes (TIFF 6.0, fill order 1)."""
    wide = np.unpackbits(frame.astype(">u2").view(np.uint8).reshape(*frame.shape, 2), axis=-1)
    return np.packbits(wide[..., 16 - bits :].reshape(len(frame), -1), axis=-1).tobytes()


@pytest.mark.parametrize("bits", range(9, 16))
def test_numbers_of_nine_to_fifteen_bits_come_back(tmp_path, bits):
    if bits % 2:
        pytest.importorskip("imagecodecs")
    frames = RNG.integers(0, 2**bits, (2, 6, 16)).astype(np.uint16)
    pages = [(packed(frame, bits), 6, 16) for frame in frames]
    path = write.tiff(tmp_path / "a.tif", pages, bits=bits)
    found = lb.open_frames(path)
    np.testing.assert_array_equal(found.read(0, 2), frames)
    assert found.full_scale_dn == 2**bits - 1


@pytest.mark.parametrize("rows", [3, 4, 5, 6, 7])
def test_packed_strips_have_so_many_rows_and_the_last_what_is_left(tmp_path, rows):
    frame = RNG.integers(0, 4096, (6, 5)).astype(np.uint16)
    parts = [packed(frame[k : k + rows], 12) for k in range(0, 6, rows)]
    gap = b"\xff\xff\xff"
    data = gap.join(parts)
    begins = 8 + np.cumsum([0, *(len(part) + 3 for part in parts[:-1])])
    tags = {278: rows}
    if len(parts) == 2:
        tags |= {273: tuple(begins.tolist()), 279: tuple(map(len, parts))}
    path = write.tiff(tmp_path / "a.tif", [(data, 6, 5)], bits=12, tags=tags)
    np.testing.assert_array_equal(lb.open_frames(path).read(0, 1)[0], frame)


@pytest.mark.parametrize(("rows", "whole"), [(3, True), (2, False)])
def test_strips_that_hold_fewer_rows_than_the_image_are_cut_short(tmp_path, rows, whole):
    frame = RNG.integers(0, 4096, (6, 5)).astype(np.uint16)
    parts = [packed(frame[:rows], 12), packed(frame[rows : 2 * rows], 12)]
    begins = (8, 8 + len(parts[0]))
    tags = {278: rows, 273: begins, 279: tuple(map(len, parts))}
    data = b"".join(parts)
    path = write.tiff(tmp_path / "a.tif", [(data, 6, 5)], bits=12, tags=tags)
    if whole:
        np.testing.assert_array_equal(lb.open_frames(path).read(0, 1)[0], frame)
    else:
        with pytest.raises(lb.UnreadableFrame, match="a.tif"):
            lb.open_frames(path)


@pytest.mark.parametrize(("over", "there"), [(0, True), (1, False)])
@pytest.mark.parametrize("bits", [12, 16])
def test_a_strip_ends_within_its_file(tmp_path, over, there, bits):
    frame = RNG.integers(0, 4096, (6, 8)).astype(np.uint16)
    data = packed(frame, bits)
    path = write.tiff(tmp_path / "a.tif", [(data, 6, 8)], bits=bits)
    size = path.stat().st_size
    begin = size - len(data) + over
    path = write.tiff(tmp_path / "a.tif", [(data, 6, 8)], bits=bits, tags={273: begin})
    assert path.stat().st_size == size
    if there:
        assert lb.open_frames(path).shape == (6, 8)
    else:
        with pytest.raises(lb.UnreadableFrame, match="page 0 of a.tif cannot be read: cut short"):
            lb.open_frames(path)


@pytest.mark.parametrize("tags", [{273: 0}, {279: 0}])
def test_a_page_of_which_nothing_is_stored_is_cut_short(tmp_path, tags):
    frame = RNG.integers(0, 4096, (6, 8)).astype(np.uint16)
    path = write.tiff(tmp_path / "a.tif", [(packed(frame, 16), 6, 8)], tags=tags)
    with pytest.raises(lb.UnreadableFrame, match="page 0 of a.tif cannot be read: cut short"):
        lb.open_frames(path)


def test_strips_that_hold_more_than_the_file_overlap(tmp_path):
    frame = np.tile(RNG.integers(0, 4096, (100, 50)), (2, 1)).astype(np.uint16)
    data = frame[:100].astype("<u2").tobytes()
    tags = {278: 100, 273: (8, 8), 279: (len(data), len(data))}
    path = write.tiff(tmp_path / "a.tif", [(data, 200, 50)], tags=tags)
    with pytest.raises(lb.UnreadableFrame, match="its strips overlap"):
        lb.open_frames(path)
    room = write.tiff(tmp_path / "b.tif", [(data + data, 200, 50)], tags=tags)
    np.testing.assert_array_equal(lb.open_frames(room).read(0, 1)[0], frame)


@pytest.mark.parametrize("photometric", [0, 1, 34892])
def test_what_counts_light_is_read_and_white_as_zero_turned(tmp_path, photometric):
    frame = RNG.integers(0, 4096, (6, 8)).astype(np.uint16)
    path = write.tiff(
        tmp_path / "a.tif", [(packed(frame, 12), 6, 8)], bits=12, photometric=photometric
    )
    found = lb.open_frames(path)
    expected = 4095 - frame if photometric == 0 else frame
    np.testing.assert_array_equal(found.read(0, 1)[0], expected)
    bits, white, notes = facts(path)
    assert (bits, white, bool(notes)) == (12, photometric == 0, photometric == 0)


@pytest.mark.parametrize("value", [0, 1, 2, 3])
def test_where_all_pages_are_smaller_copies_they_are_the_pages(tmp_path, value):
    frames = RNG.integers(0, 4096, (2, 6, 8)).astype(np.uint16)
    for kind in (value, (value,)):
        chain = _directories(write.tiff16(tmp_path / "a.tif", frames, tags={254: kind}))
        assert (len(chain.places), chain.reduced, chain.whole) == (2, 0, True)


@pytest.mark.parametrize("content", [b"", b"II", b"II*\0", b"MM\0*\0\0\0\0", b"no TIFF at all"])
def test_what_has_no_directory_is_no_tiff(tmp_path, content):
    path = tmp_path / "a.tif"
    path.write_bytes(content)
    with pytest.raises(lb.UnreadableFrame, match="a.tif cannot be read: not a TIFF, or cut short"):
        lb.open_frames(path)


@pytest.mark.parametrize("wander", [0, 900])
def test_pages_at_one_distance_pickle_to_a_few_bytes_and_all_are_as_they_were(wander):
    places = 8 + 4_147_392 * np.arange(100_000) + RNG.integers(0, wander + 1, 100_000)
    pages = Pages(Path("a.tif"), places, white_is_zero=False)
    pickled = pickle.dumps(pages)
    again = pickle.loads(pickled)
    assert (again.path, again.white_is_zero) == (pages.path, False)
    assert again.offsets.dtype == places.dtype
    np.testing.assert_array_equal(again.offsets, places)
    assert len(pickled) < (5000 if not wander else places.nbytes / 2)


@pytest.mark.parametrize("big", [False, True])
def test_directories_of_unlike_lengths_are_followed(tmp_path, big):
    """Short, long, too long to be read at once, and short again."""
    with tifffile.TiffWriter(tmp_path / "a.tif", bigtiff=big) as file:
        for more in (0, 40, 400, 3, 0, 0):
            extra = [(65000 + k, "H", 1, k, True) for k in range(more)]
            file.write(
                np.full((4, 5), more, np.uint16),
                extratags=extra,
                contiguous=False,
                metadata=None,
                photometric="minisblack",
            )
    chain = _directories(tmp_path / "a.tif")
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        assert chain.places.tolist() == [page.offset for page in file.pages]
    assert chain.whole and not chain.reduced
