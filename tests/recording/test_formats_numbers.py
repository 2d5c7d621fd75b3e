"""TIFF, video, images and pixel files as other programs write them, and their limits from either
side."""

import struct
import zlib
from dataclasses import replace
from types import SimpleNamespace

import cv2
import files_of_frames as write
import numpy as np
import pytest

import losbench as lb
from losbench.recording.frames.joined import join
from losbench.recording.frames.pixelfiles import _detector
from losbench.recording.frames.protocol import Found, decoding
from losbench.recording.frames.tiff import _directories, _segments
from losbench.recording.frames.video import _count, open_video

fits = pytest.importorskip("astropy.io.fits")
RNG = np.random.default_rng(17)
GREY = RNG.integers(0, 250, (3, 40, 48))
COLOURS = RNG.integers(0, 250, (40, 48, 4))


def read(path, **options):
    frames = lb.open_frames(path, **options)
    return frames.read(0, frames.n_frames)


# TIFF as tifffile writes it


def written(path, data, **options):
    tifffile, _ = pytest.importorskip("tifffile"), pytest.importorskip("imagecodecs")
    options = {"photometric": "minisblack"} | options
    tifffile.imwrite(path, data, metadata=None, **options)
    return path


@pytest.mark.parametrize("compression", [None, "lzw", "zlib"])
@pytest.mark.parametrize("layout", [{"rowsperstrip": 7}, {"tile": (16, 32)}])
@pytest.mark.parametrize("byteorder", ["<", ">"])
@pytest.mark.parametrize("dtype", ["u1", "u2", "f4"])
def test_grey_pages_come_back_however_they_are_stored(
    tmp_path, compression, layout, byteorder, dtype
):
    data = GREY.astype(dtype)
    how = {"compression": compression, "byteorder": byteorder, **layout}
    np.testing.assert_array_equal(read(written(tmp_path / "a.tif", data, **how)), GREY)
    if compression and dtype != "f4":
        np.testing.assert_array_equal(
            read(written(tmp_path / "b.tif", data, predictor=True, **how)), GREY
        )


@pytest.mark.parametrize("compression", [None, "lzw"])
@pytest.mark.parametrize("dtype", ["u1", "u2"])
@pytest.mark.parametrize("samples", [3, 4])
@pytest.mark.parametrize("planar", ["contig", "separate"])
def test_channels_of_tiff_keep_their_order(tmp_path, compression, dtype, samples, planar):
    data = COLOURS[..., :samples].astype(dtype)
    stored = data if planar == "contig" else np.moveaxis(data, -1, 0)
    path = written(
        tmp_path / "a.tif",
        stored,
        photometric="rgb",
        planarconfig=planar,
        compression=compression,
        extrasamples=["unassalpha"] * (samples - 3),
        rowsperstrip=9,
    )
    for k in range(samples):
        np.testing.assert_array_equal(read(path, channel=k)[0], data[..., k])


def page_of(begins, counts, data):
    """What `_segments` asks of a page."""
    reads = []

    def seek(place):
        reads.append(place)

    def read_on(n):
        return data[reads[-1] : reads[-1] + n]

    handle = SimpleNamespace(seek=seek, read=read_on)
    parent = SimpleNamespace(filehandle=handle)
    return SimpleNamespace(parent=parent, dataoffsets=begins, databytecounts=counts), reads


@pytest.mark.parametrize(("last", "seeks"), [(160, 1), (161, 3)])
def test_strips_are_read_at_once_where_they_fill_half_of_what_lies_between(last, seeks):
    data = bytes(range(256))
    begins, counts = (50, 80, last), (20, 30, 10)
    page, reads = page_of(begins, counts, data)
    whole, places = _segments(page)
    assert len(reads) == seeks
    for begin, count, place in zip(begins, counts, places, strict=True):
        at = place - 8
        assert whole[at : at + count] == data[begin : begin + count]
    assert len(whole) == (120 if seeks == 1 else 60)


def test_strips_that_lie_far_apart_are_one_image(tmp_path):
    """A file of LZW strips, each moved away from the next."""
    path = written(tmp_path / "a.tif", GREY[0].astype("u2"), compression="lzw", rowsperstrip=8)
    tifffile = pytest.importorskip("tifffile")
    with tifffile.TiffFile(path) as file:
        page = file.pages[0]
        begins, counts = list(page.dataoffsets), list(page.databytecounts)
        tag = page.tags[273]
    out = bytearray(path.read_bytes())
    moved = []
    for begin, count in zip(begins, counts, strict=True):
        out += bytes(5000)
        moved.append(len(out))
        out += out[begin : begin + count]
    lists = len(out)
    out += struct.pack(f"<{len(moved)}I", *moved)
    out[tag.offset : tag.offset + 12] = struct.pack("<HHII", 273, 4, len(moved), lists)
    (tmp_path / "b.tif").write_bytes(bytes(out))
    np.testing.assert_array_equal(read(tmp_path / "b.tif")[0], GREY[0])


@pytest.mark.parametrize("big", [False, True])
def test_smaller_copies_are_left_out_and_a_chain_that_returns_ends(tmp_path, big):
    tifffile = pytest.importorskip("tifffile")
    with tifffile.TiffWriter(tmp_path / "a.tif", bigtiff=big) as file:
        for k, kind in enumerate((0, 1, 0, 1, 0)):
            size = slice(None, None, 2 if kind else 1)
            file.write(
                GREY[k // 2, size, size].astype("u2"),
                subfiletype=kind,
                metadata=None,
                photometric="minisblack",
            )
    chain = _directories(tmp_path / "a.tif")
    assert (len(chain.places), chain.whole, chain.reduced) == (3, True, 2)
    np.testing.assert_array_equal(read(tmp_path / "a.tif"), GREY)
    said = "a.tif holds 2 smaller copies of pages: they are left out."
    assert said in lb.open_frames(tmp_path / "a.tif").notes


def test_white_as_zero_is_turned_in_every_page_or_in_none(tmp_path):
    path = written(tmp_path / "a.tif", GREY.astype("u2"), photometric="miniswhite")
    np.testing.assert_array_equal(read(path), 65535 - GREY)
    assert lb.open_frames(path).notes[0] == "In a.tif zero is white: its numbers are turned."
    tifffile = pytest.importorskip("tifffile")
    with tifffile.TiffWriter(tmp_path / "b.tif") as file:
        for frame, photometric in zip(
            GREY, ("minisblack", "minisblack", "miniswhite"), strict=True
        ):
            file.write(frame.astype("u2"), photometric=photometric, metadata=None)
    with pytest.raises(lb.UnreadableFrame, match="page 2 of b.tif turns black and white"):
        read(tmp_path / "b.tif")


# Video


class Capture:
    """What OpenCV says of a video that holds so many frames."""

    def __init__(self, held, said, rate=25.0):
        self.held, self.at = held, 0
        self.of = {cv2.CAP_PROP_FRAME_COUNT: said, cv2.CAP_PROP_FPS: rate}

    def isOpened(self):
        return True

    def get(self, what):
        return self.of.get(what, 4)

    def set(self, what, k):
        self.at = k

    def grab(self):
        self.at += 1
        return self.at <= self.held


@pytest.mark.parametrize("said", [-1, 0, 3, 4, 5, 6, 50, 1e300])
def test_frames_are_counted_where_the_container_guesses(tmp_path, said):
    (tmp_path / "a.avi").write_bytes(bytes(40))
    capture = Capture(5, said)
    assert _count(capture, tmp_path / "a.avi") == 5
    assert capture.at == 0


@pytest.mark.parametrize(
    ("rate", "timed"), [(0.0, False), (1e-3, True), (0.99e6, True), (1e6, False), (np.nan, False)]
)
def test_a_rate_below_a_megahertz_gives_times(tmp_path, monkeypatch, rate, timed):
    (tmp_path / "a.avi").write_bytes(bytes(40))
    monkeypatch.setattr(
        "losbench.recording.frames.video.opened", lambda *_: Capture(5, 5, rate=rate)
    )
    found = open_video(tmp_path / "a.avi")
    assert (found.time_s is not None) == timed == bool(found.notes)
    if timed:
        np.testing.assert_allclose(found.time_s, np.arange(5) / rate)


def test_colours_of_a_video_are_red_first(tmp_path):
    path = str(tmp_path / "a.avi")
    out = cv2.VideoWriter(path, cv2.VideoWriter_fourcc(*"MJPG"), 25, (64, 48), isColor=True)
    if not out.isOpened():
        pytest.skip("this OpenCV writes no MJPG")
    for _ in range(3):
        out.write(np.full((48, 64, 3), (20, 90, 200), np.uint8))  # blue first
    out.release()
    for channel, value in (("red", 200), ("green", 90), ("blue", 20)):
        assert np.abs(read(path, channel=channel).astype(int) - value).max() <= 12


# Images


def test_a_header_may_claim_what_pillow_calls_no_bomb(tmp_path):
    image = pytest.importorskip("PIL.Image")
    chunk = b"IHDR" + struct.pack(">IIBBBBB", 400_000, 400_000, 8, 0, 0, 0, 0)
    whole = struct.pack(">I", 13) + chunk + struct.pack(">I", zlib.crc32(chunk))
    whole += struct.pack(">I", 0) + b"IDAT" + struct.pack(">I", zlib.crc32(b"IDAT"))
    (tmp_path / "a.png").write_bytes(b"\x89PNG\r\n\x1a\n" + whole)
    most = f"{2 * image.MAX_IMAGE_PIXELS:_}"
    with pytest.raises(lb.UnreadableFrame, match=f"its header claims more than {most} pixels"):
        lb.open_frames(tmp_path / "a.png")


@pytest.mark.parametrize(
    ("colour", "side", "more"), [(0, (8192, 8192), (8192, 8193)), (2, (2896, 2896), (2897, 2897))]
)
def test_a_header_may_claim_64_mebibytes_of_a_byte_a_pixel_or_eight(tmp_path, colour, side, more):
    """Eight for all that is not grey of eight bits: four channels of sixteen."""
    for (rows, columns), believed in ((side, True), (more, False), (more[::-1], False)):
        chunk = b"IHDR" + struct.pack(">IIBBBBB", columns, rows, 8, colour, 0, 0, 0)
        whole = struct.pack(">I", 13) + chunk + struct.pack(">I", zlib.crc32(chunk))
        whole += struct.pack(">I", 0) + b"IDAT" + struct.pack(">I", zlib.crc32(b"IDAT"))
        (tmp_path / "a.png").write_bytes(b"\x89PNG\r\n\x1a\n" + whole)
        said = "not an image, or cut short" if believed else "cannot hold"
        with pytest.raises(lb.UnreadableFrame, match=said):
            lb.open_frames(tmp_path / "a.png")


@pytest.mark.parametrize(("size", "believed"), [((4096, 5461), True), ((4096, 5462), False)])
def test_a_video_may_claim_64_mebibytes_of_three_channels(tmp_path, monkeypatch, size, believed):
    (tmp_path / "a.avi").write_bytes(bytes(40))
    for width, height in (size, size[::-1]):
        capture = Capture(5, 5)
        capture.of |= {cv2.CAP_PROP_FRAME_WIDTH: width, cv2.CAP_PROP_FRAME_HEIGHT: height}
        monkeypatch.setattr("losbench.recording.frames.video.opened", lambda *_, of=capture: of)
        if believed:
            assert open_video(tmp_path / "a.avi").source.n_frames == 5
        else:
            with pytest.raises(lb.UnreadableFrame, match="cannot hold"):
                open_video(tmp_path / "a.avi")


def test_a_file_of_a_folder_has_one_page(tmp_path):
    for k in range(3):
        write.tiff16(tmp_path / f"a-{k}.tif", GREY[k : k + 1])
    np.testing.assert_array_equal(read(tmp_path), GREY)
    write.tiff16(tmp_path / "a-2.tif", GREY[:2])
    with pytest.raises(
        lb.UnreadableFrame, match=r"a-2.tif must be one image as the first file, but"
    ):
        read(tmp_path)


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("lost", [0, 1, 4, 40])
def test_a_page_is_there_if_its_directory_is_whole(tmp_path, lost, big):
    path = write.tiff16(tmp_path / "a.tif", GREY, big=big)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) - lost])
    chain = _directories(path)
    assert (len(chain.places), chain.whole) == ((3, True) if not lost else (2, False))


# Pixel files, and masks beside images


def pixel_file(path, quality, corner):
    n = len(quality)
    columns = [
        fits.Column("TIME", "D", array=np.arange(n) / 86400),
        fits.Column("FLUX", "20E", dim="(5,4)", array=np.ones((n, 4, 5))),
        fits.Column("QUALITY", "J", array=quality),
    ]
    table = fits.BinTableHDU.from_columns(columns)
    table.header["1CRV5P"], table.header["2CRV5P"] = corner
    fits.HDUList([fits.PrimaryHDU(), table]).writeto(path)


@pytest.mark.parametrize("marked", [0, 1])
def test_one_marked_frame_is_worth_a_word_and_none_is_not(tmp_path, marked):
    pixel_file(tmp_path / "a.fits", [0, 0, marked], (100, 200))
    notes = lb.read_recording(tmp_path / "a.fits").notes
    assert [note[:11] for note in notes if "QUALITY" in note] == ["1 of 3 fram"] * marked


@pytest.mark.parametrize(("gain", "floor"), [(4.0, 9.0), (0.0, 0.0), (-1.0, 900.0)])
def test_a_pixel_file_s_own_errors_tell_the_detector(gain, floor):
    """Variance = flux / gain + read noise; none where it does not grow with the flux."""
    flux = np.linspace(10.0, 500.0, 60)
    variance = (flux / gain if gain else 0.0 * flux) + floor
    found = _detector(np.stack([flux, variance]))
    if gain > 0:
        assert found.gain_e_per_dn == pytest.approx(gain)
        assert found.read_noise_e == pytest.approx(gain * np.sqrt(floor))
    else:
        assert found is None
    assert _detector(np.full((2, 60), np.nan)) is None


@pytest.mark.parametrize("known", [(True, True), (True, False), (False, True), (False, False)])
def test_times_go_on_over_files_where_all_know_utc(known):
    second = np.timedelta64(10**9, "ns")
    starts = np.datetime64("2026-03-01T12:00:00", "ns") + np.array([0, 90]) * second
    parts = [
        Found(
            name=f"{k}",
            source=SimpleNamespace(n_frames=3),
            time_s=np.arange(3.0),
            start=start if utc else None,
        )
        for k, (start, utc) in enumerate(zip(starts, known, strict=True))
    ]
    found = join(parts, "both")
    if all(known):
        np.testing.assert_allclose(found.time_s, [0, 1, 2, 90, 91, 92])
        assert found.start == starts[0]
    else:
        assert found.time_s is None and found.start is None
    untimed = join([parts[0], replace(parts[1], time_s=None)], "both")
    assert untimed.time_s is None and untimed.source.n_frames == 6
    assert join(parts[:1], "one") is parts[0]


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (ValueError(), "ValueError"),
        (OSError(5, "broken  pipe"), "[Errno 5] broken pipe"),
        (KeyError("BITPIX"), "BITPIX is missing"),
        (KeyError("two words"), "two words"),
        (ValueError("x" * 300), "x" * 200),
        (ValueError("one\nline"), "one line"),
    ],
)
def test_what_a_decoder_raises_is_told_in_a_line(error, said):
    with pytest.raises(lb.UnreadableFrame) as told, decoding("a.fits"):
        raise error
    assert str(told.value) == f"a.fits cannot be read: {said}"


def test_single_frames_are_read_to_the_last():
    stamp = lb.read_recording(GREY.astype(np.uint16), period_s=1.0).stamps[0]
    for k in range(3):
        np.testing.assert_array_equal(stamp.load(k), GREY[k])


@pytest.mark.parametrize("head", ["", "x,y\n", "x_px,y_px\n", "# x y\n", "X1;Y1\n"])
def test_a_list_of_bad_pixels_may_have_a_head(tmp_path, head):
    (tmp_path / "bad.csv").write_text(f"{head}3,2\n\n7 5 # hot\n")
    recording = lb.read_recording(
        GREY.astype(np.uint16), period_s=1.0, bad_pixels=tmp_path / "bad.csv"
    )
    bad = np.isnan(recording.stamps[0].read(0, 1, skip=False).frames[0])
    assert np.argwhere(bad).tolist() == [[2, 3], [5, 7]]
    (tmp_path / "bad.csv").write_text("3,2\nx,y\n")
    with pytest.raises(ValueError, match="got 'x,y' in line 2"):
        lb.read_recording(GREY.astype(np.uint16), period_s=1.0, bad_pixels=tmp_path / "bad.csv")


def test_a_frame_that_one_of_two_files_marks_is_counted_once(tmp_path):
    pixel_file(tmp_path / "a.fits", [0, 1, 4, 0, 0, 0], (100, 200))
    pixel_file(tmp_path / "b.fits", [0, 0, 8, 1, 0, 0], (300, 200))
    recording = lb.read_recording(tmp_path)
    assert recording.notes[0].startswith("3 of 6 frames have a QUALITY that is not zero")
    kept = [stamp.read(0, 6, skip=False).good.tolist() for stamp in recording.stamps]
    assert kept == [
        [True, False, False, True, True, True],
        [True, True, False, False, True, True],
    ]


@pytest.mark.parametrize(("images", "masks"), [(1, 1), (3, 3), (3, 1), (3, 2)])
def test_masks_belong_to_their_images_where_there_are_as_many(tmp_path, images, masks):
    frames = RNG.integers(1, 900, (images, 20, 30)).astype("i2")
    flags = np.zeros((masks, 20, 30), "i2")
    for k in range(masks):
        flags[k, 2 + k, 5] = 1
    hdus = [fits.PrimaryHDU(), *(fits.ImageHDU(frame, name="SCI") for frame in frames)]
    hdus += [fits.ImageHDU(mask, name="DQ") for mask in flags]
    fits.HDUList(hdus).writeto(tmp_path / "a.fits")
    recording = lb.read_recording(tmp_path / "a.fits")
    stack = recording.stamps[0].read(0, images, skip=False).frames
    expected = np.zeros((images, 20, 30), bool)
    if images == masks:
        expected[:] = flags != 0
    else:
        expected[:] = flags[0] != 0
    np.testing.assert_array_equal(np.isnan(stack), expected)
