"""Only the rows around the spots are read, and every number is that of the whole frames."""

import struct

import files_of_frames as write
import numpy as np
import pytest
import tifffile

import losbench as lb
from losbench.recording.bands import Bands
from losbench.recording.frames import contiguous, handles
from losbench.recording.frames.plainpages import only_page, plain_page

SHAPE, N = (400, 120), 40
SPOTS = np.array([[30.0, 60.0], [90.0, 300.0]])
DETECTOR = lb.Detector(gain_e_per_dn=2.0, read_noise_e=5.0, offset_dn=100.0)


@pytest.fixture(scope="module")
def frames():
    """Two spots that drift; the second jumps out of reach within a block, and leaves at the end."""
    path = SPOTS + np.linspace(0, 6, N)[:, None, None] + np.array([0.0, 0.3])
    path[21:, 1, 1] += 8.0
    light = np.full((N, 2), 1e5)
    light[35:, 1] = 0.0
    electrons = [
        lb.render_spots(xy, f, 2.0, SHAPE) + 40.0 for xy, f in zip(path, light, strict=True)
    ]
    return DETECTOR.expose(np.stack(electrons), 3)


def npy(folder, frames):
    np.save(folder / "stack.npy", frames)
    return folder / "stack.npy"


def big_endian_npy(folder, frames):
    np.save(folder / "stack.npy", frames.astype(frames.dtype.newbyteorder(">")))
    return folder / "stack.npy"


def pages(folder, frames, **options):
    with tifffile.TiffWriter(folder / "pages.tif", **options) as file:
        for frame in frames:
            file.write(frame, contiguous=False, photometric="minisblack")
    return folder / "pages.tif"


def big_pages_in_strips(folder, frames):
    with tifffile.TiffWriter(folder / "pages.tif", bigtiff=True, byteorder=">") as file:
        for frame in frames:
            file.write(frame, contiguous=False, photometric="minisblack", rowsperstrip=16)
    return folder / "pages.tif"


def folder_of_pages(folder, frames):
    (folder / "pages").mkdir()
    for k, frame in enumerate(frames):
        tifffile.imwrite(folder / "pages" / f"{k:03d}.tif", frame, photometric="minisblack")
    return folder / "pages"


def two_files(folder, frames):
    for name, part in [("a", frames[:15]), ("b", frames[15:])]:
        np.save(folder / f"{name}.npy", part)
    return [folder / "a.npy", folder / "b.npy"]


def ser(folder, frames):
    return write.ser(folder / "a.ser", frames, depth=16, order=">")


def raw_between_gaps(folder, frames):
    return write.raw(folder / "a", frames, "mono16", header_bytes=5, gap_bytes=3, byte_order="big")


def packed(folder, frames):
    assert frames.max() < 2**14
    return write.raw(folder / "a", frames, "mono14p", header_bytes=5, gap_bytes=3)


KINDS = [
    npy,
    big_endian_npy,
    pages,
    big_pages_in_strips,
    folder_of_pages,
    two_files,
    ser,
    raw_between_gaps,
    packed,
]


def same(one, other):
    for name in ("xy_px", "sigma_xy_px", "flags"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_the_rows_around_spots_tell_the_same_as_whole_frames(frames, tmp_path, kind, monkeypatch):
    read, real = [], handles._read_at
    whole = lb.measure(lb.read_recording(frames, detector=DETECTOR), spots=SPOTS)
    recording = lb.read_recording(kind(tmp_path, frames), detector=DETECTOR)
    surveyed = lb.measure(recording, spots=SPOTS)  # every frame too, for there are fewer than 64
    monkeypatch.setattr(handles, "_read_at", lambda *job: read.append(len(job[2])) or real(*job))
    rows = lb.measure(recording, spots=SPOTS)
    same(rows, whole)
    same(surveyed, whole)
    again = 16 * frames[0].nbytes  # the first, and those in which one jumps or is lost
    assert 0 < sum(read) < 2 * 0.6 * frames.nbytes + again


@pytest.mark.parametrize(
    "options",
    [
        {"centroid": lb.Weighted(), "background": lb.Ring(25)},
        {"centroid": lb.EIWA(13, hot_pixel_gate=True), "background": lb.Ring(15)},
        {"centroid": "grey", "background": None},
        {"centroid": lb.EIWA(centre="start")},
    ],
    ids=str,
)
@pytest.mark.parametrize("kind", ["uint8", "uint16", "float32"])
def test_whatever_is_chosen(frames, tmp_path, options, kind):
    given = (frames // 16 if kind == "uint8" else frames).astype(kind)
    whole, rows = (
        lb.measure(lb.read_recording(source), spots=SPOTS, **options)
        for source in (given, npy(tmp_path, given))
    )
    same(rows, whole)


def test_bad_pixels_stay_bad_and_unreadable_frames_are_skipped(frames, tmp_path):
    bad = np.zeros(SHAPE, bool)
    bad[75, 31] = bad[5, 5] = True
    path = folder_of_pages(tmp_path, frames)
    cut = (path / "012.tif").read_bytes()
    (path / "012.tif").write_bytes(cut[: len(cut) // 4])
    recording = lb.read_recording(path, on_unreadable="skip", detector=DETECTOR)
    stamp = recording.stamps[0]
    block = stamp.read(8, 16, skip=True, spans=[(40, 80)])
    assert block.good.tolist() == [True] * 4 + [False] + [True] * 3
    assert "012.tif cannot be read" in block.skipped[12]
    np.testing.assert_array_equal(block.frames[0], frames[8, 40:80])
    assert not block.frames[4].any()
    masked = lb.read_recording(npy(tmp_path, frames), bad_pixels=bad, detector=DETECTOR)
    same(
        lb.measure(masked, spots=SPOTS),
        lb.measure(lb.read_recording(frames, bad_pixels=bad, detector=DETECTOR), spots=SPOTS),
    )


def test_systems_without_positioned_reads_read_all_the_same(frames, tmp_path, monkeypatch):
    stamp = lb.read_recording(npy(tmp_path, frames)).stamps[0]
    for name in ("preadv", "posix_fadvise"):
        monkeypatch.delattr(handles.os, name, raising=False)
    block = stamp.read(3, 6, skip=False, spans=[(10, 20), (390, 400)])
    np.testing.assert_array_equal(block.frames[:, 10:], frames[3:6, 390:])
    np.testing.assert_array_equal(stamp.read(3, 6, skip=False).frames, frames[3:6])


@pytest.mark.parametrize("columns", [8, 6, 5])
@pytest.mark.parametrize("pixels", ["mono10p", "mono12p", "mono14p", "mono12packed"])
def test_rows_of_packed_frames_wherever_they_begin(tmp_path, pixels, columns, monkeypatch):
    """Of 8 columns every row begins at a whole byte, of 6 and 5 of 12 bits or none."""
    bits = int(pixels[4:6])
    frames = np.random.default_rng(columns).integers(0, 2**bits, (3, 20, columns)).astype("u2")
    stamp = lb.read_recording(write.raw(tmp_path / "a", frames, pixels, gap_bytes=2)).stamps[0]
    read, real = [], handles._read_at
    monkeypatch.setattr(handles, "_read_at", lambda *job: read.append(len(job[2])) or real(*job))
    block = stamp.read(1, 3, skip=False, spans=[(1, 4), (13, 20)])
    np.testing.assert_array_equal(block.frames[:, :3], frames[1:, 1:4])
    np.testing.assert_array_equal(block.frames[:, 3:], frames[1:, 13:])
    some = bits * columns % 8 == 0
    assert sum(read) == 2 * (10 if some else 20) * columns * bits // 8


def test_left_aligned_numbers_are_divided_row_by_row(frames, tmp_path):
    stamp = lb.read_recording(npy(tmp_path, frames * np.uint16(16))).stamps[0]
    assert stamp.frames.step == 16
    np.testing.assert_array_equal(
        stamp.read(0, 2, skip=False, spans=[(50, 70)]).frames, frames[:2, 50:70]
    )


def test_bands_are_what_a_window_and_its_ring_can_reach():
    places = np.array([[[20.0, 300.0], [20.0, 60.0]], [[20.0, 300.0], [20.0, 61.5]]])
    bands = Bands.around(places, 13, 25, 400)
    (a, b), (c, d) = bands.spans
    reach = 3 + 13 + 12 + 4  # to the peak, with the window, the ring's square, the ring
    assert a <= 60 - reach and b >= 62 + reach + 1 and c <= 300 - reach and d >= 300 + reach + 1
    assert b - a < 2 * reach + 20
    assert bands.above.tolist() == [c - (b - a), a]
    image = np.arange(400)
    rows = np.concatenate([image[begin:end] for begin, end in bands.spans])
    inside = bands.within(np.round(places))
    assert rows[inside[..., 1].astype(int)].tolist() == np.round(places[..., 1]).tolist()
    np.testing.assert_array_equal(bands.outside(inside), np.round(places))
    assert bands.hold(places[0] + [50.0, 4.0]) and bands.hold(places[1] - [50.0, 4.0])
    assert not bands.hold(places[1] + [0.0, 4.1]) and not bands.hold(places[0] - [0.0, 4.1])
    one = Bands.around(places[:, ::-1], 13, 25, 150)  # the second beyond the frame
    assert Bands.around(places[:, 1:], 13, 25, 120).spans is None is one.spans
    whole = Bands.around(places, None, None, 400)
    assert whole.spans is None and whole.hold(places[0] + 1e4)


PLAIN = {"photometric": "minisblack"}
KEPT = [
    ({}, "uint8"),
    ({}, "uint16"),
    ({"byteorder": ">"}, "uint16"),
    ({"bigtiff": True}, "float32"),
    ({"rowsperstrip": 7}, "uint16"),
    ({"description": "long " * 50, "software": "x"}, "float64"),
]
LEFT = [
    ({"tile": (16, 16)}, "uint16"),
    ({"compression": "zlib"}, "uint16"),
    ({"photometric": "miniswhite"}, "uint8"),
    ({}, "int16"),
    ({"predictor": 2, "compression": "zlib"}, "uint16"),
]


@pytest.mark.parametrize(("options", "dtype"), KEPT + LEFT, ids=str)
def test_a_plain_page_lies_where_tifffile_says(tmp_path, options, dtype):
    image = np.random.default_rng(1).integers(0, 120, (32, 48)).astype(dtype)
    writer = {k: options[k] for k in ("byteorder", "bigtiff") if k in options}
    rest = {**PLAIN, **{k: v for k, v in options.items() if k not in writer}}
    tifffile.imwrite(tmp_path / "page.tif", image, **writer, **rest)
    with (tmp_path / "page.tif").open("rb", buffering=0) as file:
        page = only_page(file)
    if (options, dtype) in LEFT:
        assert page is None
        return
    with tifffile.TiffFile(tmp_path / "page.tif") as file:
        assert page.offset == file.pages[0].dataoffsets[0]
        assert page.shape == file.pages[0].shape and page.dtype.newbyteorder("=") == dtype
    found = np.fromfile(tmp_path / "page.tif", page.dtype, image.size, offset=page.offset)
    np.testing.assert_array_equal(found.reshape(image.shape), image)


def test_colours_several_pages_and_damage_are_left_to_the_general_reader(tmp_path):
    image = np.arange(32 * 48, dtype=np.uint16).reshape(32, 48)
    tifffile.imwrite(tmp_path / "rgb.tif", np.stack([image] * 3, axis=-1), photometric="rgb")
    tifffile.imwrite(tmp_path / "two.tif", np.stack([image] * 2), **PLAIN)
    tifffile.imwrite(tmp_path / "one.tif", image, **PLAIN)
    whole = (tmp_path / "one.tif").read_bytes()
    for name in ("rgb", "two"):
        with (tmp_path / f"{name}.tif").open("rb", buffering=0) as file:
            assert only_page(file) is None
    at = struct.unpack_from("<I", whole, 4)[0]
    rng = np.random.default_rng(3)
    for cut in (0, 3, 10, at + 1, at + 30, len(whole) - 1):
        (tmp_path / "cut.tif").write_bytes(whole[:cut])
        with (tmp_path / "cut.tif").open("rb", buffering=0) as file:
            assert only_page(file) is None
    for _ in range(300):
        damaged = bytearray(whole)
        for place in rng.integers(at, at + 200, 3):
            damaged[place] = rng.integers(256)
        (tmp_path / "damaged.tif").write_bytes(damaged)
        with (tmp_path / "damaged.tif").open("rb", buffering=0) as file:
            page = plain_page(file, at)
        assert page is None or page.offset + np.prod(page.shape) * page.dtype.itemsize <= len(whole)


def test_contiguous_frames_of_colour_are_read_whole(tmp_path):
    colour = np.zeros((2, 40, 30, 3), np.uint8)
    np.save(tmp_path / "rgb.npy", colour)
    source = lb.open_frames(tmp_path / "rgb.npy").source
    assert isinstance(source, contiguous.Contiguous)
    assert not source.rows(0, (40, 30), [(0, 5)], np.zeros((5, 30), np.uint8))
