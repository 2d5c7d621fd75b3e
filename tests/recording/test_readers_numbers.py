"""Numbers of the readers, the clock and what is said of a recording, from either side."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import files_of_frames as write
import numpy as np
import pandas as pd
import pytest

import losbench as lb
from losbench.imaging.noise import Gain, Transfer
from losbench.recording.contradiction import contradictions
from losbench.recording.frames.contiguous import Contiguous
from losbench.recording.frames.names import belonging
from losbench.recording.frames.plane import Plane, _date, _role, _without_ones, _word
from losbench.recording.frames.ser import _order
from losbench.recording.frames.tiff import _opencv_reads
from losbench.recording.performance import metrics_of
from losbench.recording.stamps import Stamp

RNG = np.random.default_rng(19)


# What belongs to a series


def files(main, *others):
    names = [f"frame-{k}.png" for k in range(main)]
    for k, count in enumerate(others):
        names += [f"{'abcdefg'[k]}{j}.png" for j in range(count)]
    return [Path("night") / name for name in names]


@pytest.mark.parametrize(
    ("main", "others", "kept"),
    [
        (8, (1, 1), 8),  # a fifth
        (8, (2,), 8),
        (7, (1, 1), 9),  # more: no series, and no strangers
        (12, (3,), 12),
        (11, (3,), None),  # two series
        (3, (1,), 4),
        (4, (1,), 4),
        (2, (1,), 3),
        (9, (), 9),
        (3, (3,), None),
        (2, (2, 2), 6),
    ],
)
def test_up_to_a_fifth_of_the_files_are_strangers_and_three_make_a_series(main, others, kept):
    given = files(main, *others)
    if kept is None:
        with pytest.raises(ValueError, match="night holds more than one series") as told:
            belonging(given)
        said = f"frame-#.png ({main} files), a#.png ({others[0]} files): choose one, as in night/"
        assert said in str(told.value) and str(told.value).endswith("night/frame-*.png")
        return
    found, notes = belonging(given)
    assert found == given[:kept] and bool(notes) == (kept < len(given))


# Numbers of a FITS file


def plane_of(bitpix=16, bscale=1.0, bzero=0.0, blank=None, shape=(4, 5)):
    return Plane(0, shape, bitpix, bscale, bzero, blank, 0, None, "", False)


@pytest.mark.parametrize("bitpix", [8, 16, 32, -32, -64])
@pytest.mark.parametrize(
    ("bscale", "bzero"), [(1.0, 0.0), (2.5, 0.0), (1.0, 7.0), (1.0, 32768.0), (0.5, -3.0)]
)
@pytest.mark.parametrize("blank", [None, 3])
def test_stored_numbers_are_scaled_by_the_standard(bitpix, bscale, bzero, blank):
    """FITS standard 4.4.2.5: BZERO + BSCALE times what is stored; BLANK before that."""
    kind = {8: "u1", 16: "i2", 32: "i4", -32: "f4", -64: "f8"}[bitpix]
    raw = RNG.integers(0, 100, (4, 5)).astype(kind)
    raw[0, 0] = 3
    found = plane_of(bitpix, bscale, bzero, blank)._meant(raw)
    expected = bzero + bscale * raw.astype(float)
    if blank is not None and bitpix > 0:
        expected[raw == 3] = np.nan
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    if bitpix == 16 and (bscale, bzero, blank) == (1.0, 32768.0, None):
        assert found.dtype == np.uint16
    if (bscale, bzero) == (1.0, 0.0) and (blank is None or bitpix < 0):
        assert found.dtype == raw.dtype


@pytest.mark.parametrize(
    ("fields", "bits"),
    [
        ({"blank": 3}, 15),
        ({"blank": 3, "bzero": 32768.0}, 16),
        ({"blank": 3, "bitpix": 8}, 8),
        ({"blank": 3, "bitpix": 8, "bzero": 128.0}, 8),
        ({"blank": 3, "bitpix": 32}, 31),
        ({"blank": 3, "bitpix": 32, "bzero": 2.0**31}, 32),
        ({}, None),
        ({"blank": 3, "bscale": 2.0}, None),
        ({"blank": 3, "bzero": 1.0}, None),
        ({"blank": 3, "bitpix": -32}, None),
    ],
)
def test_undefined_pixels_leave_the_bits_of_the_integers(fields, bits):
    assert plane_of(**fields).bits == bits


@pytest.mark.parametrize(
    ("bitpix", "shape", "size", "frames"),
    [(8, (4, 5), 20, 1), (16, (4, 5), 40, 1), (-64, (3, 4, 5), 160, 3), (32, (7, 4, 6), 96, 7)],
)
def test_a_plane_knows_the_length_of_its_frames(bitpix, shape, size, frames):
    plane = plane_of(bitpix, shape=shape)
    assert (plane.frame_bytes, plane.n_frames) == (size, frames)


@pytest.mark.parametrize(
    ("name", "role"),
    [
        ("SCI", "science"),
        (" image ", "science"),
        ("SCIENCE", "science"),
        ("SCI2", "image"),
        ("", "image"),
        ("DQ", "mask"),
        ("dq_flags", "mask"),
        ("BADPIX", "mask"),
        ("ERR", "uncertainty"),
        ("WEIGHTS", "uncertainty"),
        ("IVAR", "uncertainty"),
        ("SAMP", "other"),
        ("PSF", "other"),
        ("BACKGROUND", "other"),
        ("FRAME", "image"),
    ],
)
def test_an_extension_is_what_its_name_begins_with(name, role):
    assert _role(name) == role


def test_headers_say_what_the_first_of_them_says():
    assert _without_ones((1, 1, 4, 5)) == (4, 5) and _without_ones((1, 3, 4, 5)) == (3, 4, 5)
    assert _without_ones((1, 4)) == (1, 4) and _without_ones((3, 1, 4, 5)) == (3, 1, 4, 5)
    assert _word("A", {}, {"A": " x "}) == "X" and _word("A", {"A": "y"}, {"A": "x"}) == "Y"
    assert _word("A", {}) == ""
    assert _date({"DATE-OBS": "2026-01-02T03:04:05"}) == "2026-01-02T03:04:05"
    assert _date({"DATE-OBS": "2026-01-02", "TIME-OBS": "03:04:05"}) == "2026-01-02T03:04:05"
    assert _date({"DATE-OBS": "2026-01-02"}) is None and _date({"TIME-OBS": "03:04"}) is None
    both = {"DATE-OBS": "2026-01-02T03:04:05", "TIME-OBS": "06:07:08"}
    assert _date(both) == "2026-01-02T03:04:05"


# Stacks in one page of a TIFF


@pytest.mark.parametrize(("photometric", "bits"), [(1, 16), (0, 16), (1, 12)])
def test_a_stack_in_one_page_is_black_as_zero_and_of_whole_bytes_or_refused(
    tmp_path, photometric, bits
):
    frames = RNG.integers(0, 900, (6, 20, 32)).astype(np.uint16)
    path, depth = tmp_path / "a.tif", {32997: 6}
    body = frames.tobytes()[: frames.nbytes * bits // 16]
    write.tiff(path, [(body, 20, 32)], tags=depth, photometric=photometric, bits=bits)
    if (photometric, bits) == (1, 16):
        found = lb.open_frames(path)
        np.testing.assert_array_equal(found.read(0, 6), frames)
        assert found.n_frames == 6
    else:
        with pytest.raises(lb.UnreadableFrame, match=r"a.tif cannot be read: .* in one page"):
            lb.open_frames(path)


@pytest.mark.parametrize("axes", ["YX", "YXS", "SYX"])
@pytest.mark.parametrize("samples", [1, 2, 3, 4])
@pytest.mark.parametrize(
    ("bits", "form"), [(8, 1), (16, 1), (32, 3), (32, 1), (16, 2), (8, 3), (64, 3), (12, 1)]
)
def test_lzw_of_grey_and_rgb_in_whole_bytes_needs_no_extra(axes, samples, bits, form):
    """OpenCV reads them; the rest is for tifffile with its extra."""
    page = SimpleNamespace(
        axes=axes, samplesperpixel=samples, bitspersample=bits, sampleformat=form
    )
    colours = axes == "YX" or (axes == "YXS" and samples in (1, 3))
    known = (bits, form) in ((8, 1), (16, 1), (32, 3))
    assert _opencv_reads(page) == (colours and known)


@pytest.mark.parametrize("kind", ["packed", "turned", "plain"])
def test_rows_of_pages_are_those_of_whole_frames_however_they_lie(tmp_path, kind):
    frames = RNG.integers(0, 900, (4, 20, 30)).astype(np.uint16)
    path = tmp_path / "a.tif"
    if kind == "packed":
        assert cv2.imwritemulti(str(path), list(frames))
    else:
        write.tiff16(path, frames, photometric=int(kind == "plain"))
    found, out, spans = lb.open_frames(path), np.empty((2, 5, 30), np.uint16), [(2, 4), (9, 12)]
    expected = 65535 - frames if kind == "turned" else frames
    found.read_rows(1, 3, spans, out)
    np.testing.assert_array_equal(
        out, np.concatenate([expected[1:3, 2:4], expected[1:3, 9:12]], axis=1)
    )
    assert found.source.rows(1, (20, 30), spans, out[0]) == (kind == "plain")
    assert not found.source.rows(1, (20, 30), spans, out[0].astype(np.float32))


# The order of bytes of a SER file


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize(("depth", "level"), [(12, 4000), (12, 3), (16, 30_000), (16, 65_000)])
def test_numbers_tell_the_order_of_their_bytes(tmp_path, order, depth, level):
    """By what fits into the bits, or else by how smooth an image is."""
    smooth = level + np.add.outer(np.arange(20), np.arange(30)) // 4
    if depth == 12 and level == 4000:
        smooth = np.minimum(smooth, 4095)
    path = tmp_path / "a.raw"
    path.write_bytes(smooth.astype(f"{order}u2").tobytes())
    stored = Contiguous(path=path, offsets=0, n_frames=1, shape=(20, 30), dtype=np.dtype("<u2"))
    assert _order(stored, depth) == np.dtype(f"{order}u2")


# Doubts


DETECTOR = lb.Detector(gain_e_per_dn=2.0, read_noise_e=5.0, offset_dn=100.0)


@pytest.mark.parametrize(
    ("per_dn", "error", "said"),
    [
        (0.574, 0.001, False),
        (0.576, 0.001, True),
        (0.426, 0.001, False),
        (0.424, 0.001, True),
        (0.579, 0.02, False),
        (0.581, 0.02, True),
        (0.421, 0.02, False),
        (0.419, 0.02, True),
    ],
)
def test_a_gain_is_another_by_four_errors_and_fifteen_percent(per_dn, error, said):
    assert bool(contradictions(DETECTOR, Gain(per_dn, error))) == said


@pytest.mark.parametrize("level", [100.0, 300.0, 20.0])
@pytest.mark.parametrize(
    ("times", "said"), [(1.38, False), (1.42, True), (1 / 1.38, False), (1 / 1.42, True)]
)
def test_rings_scatter_otherwise_by_a_factor_of_one_point_four(level, times, said):
    expected = float(DETECTOR.variance_dn(level))
    if expected <= 0:
        assert contradictions(DETECTOR, with_curve(1.0, level))
        return
    told = contradictions(DETECTOR, with_curve(times * expected, level))
    assert bool(told) == said
    if said:
        assert f"at {level:.4g} DN, they scatter by {np.sqrt(times * expected):.3g} DN" in told[0]
        assert told[0].endswith(f"read noise say {np.sqrt(expected):.3g}.")


def with_curve(floor, level, step=0.0):
    return Gain(0.5, 0.01, step, Transfer(*np.zeros((3, 1)), floor, level))


def test_what_is_not_known_or_coarse_contradicts_nothing():
    assert not contradictions(DETECTOR, Gain(0.9, np.inf))
    assert not contradictions(DETECTOR, with_curve(60.0, 100.0, step=16.0))
    assert contradictions(DETECTOR, with_curve(60.0, 100.0, step=1.0))


# Metrics


def measured(n, known=None, period=2.0, gap=None):
    time_s = period * np.arange(n, dtype=float)
    if gap is not None:
        time_s[gap:] += 100.0
    angles = 1e-6 * np.random.default_rng(3).standard_normal((n, 3))
    angles[known if known is not None else n :] = np.nan
    return SimpleNamespace(
        attitude=SimpleNamespace(angles=angles), table=pd.DataFrame({"time_s": time_s})
    )


@pytest.mark.parametrize(("n", "told"), [(19, False), (20, True), (21, True)])
def test_twenty_frames_with_angles_have_metrics(n, told):
    assert (metrics_of(measured(n)) is not None) == told
    assert (metrics_of(measured(40, known=n)) is not None) == told


@pytest.mark.parametrize(("n", "samples"), [(20, 4), (40, 4), (49, 4), (50, 5), (300, 30)])
def test_windows_are_a_tenth_of_the_record_and_four_frames_at_least(n, samples):
    found = metrics_of(measured(n, period=0.5))
    assert found.window_s == pytest.approx(0.5 * samples)
    assert metrics_of(measured(n), 16.0).window_s == pytest.approx(16.0)


def test_metrics_need_times_that_increase_and_a_whole_window():
    back = measured(30)
    back.table["time_s"] = back.table["time_s"].to_numpy()[::-1]
    assert metrics_of(back) is None
    holes = measured(300)
    holes.attitude.angles[::20] = np.nan
    assert metrics_of(holes) is None  # of 30 frames no window is whole
    untimed = measured(30)
    del untimed.table["time_s"]
    assert metrics_of(untimed) is None
    with pytest.raises(ValueError, match="window_s needs angles over time"):
        metrics_of(untimed, 4.0)
    some = measured(60)
    some.table.loc[::2, "time_s"] = np.nan
    found = metrics_of(some)
    assert found is not None and found.window_s == pytest.approx(16.0)


# Full scale of a recording


@pytest.mark.parametrize(
    ("dtype", "bits", "full"),
    [(np.uint8, 16, 255), (np.uint16, 10, 1023), (np.uint16, None, 65535)],
)
def test_full_scale_is_that_of_the_numbers_or_of_a_detector_that_comes_first(dtype, bits, full):
    detector = None if bits is None else lb.Detector(bits=bits)
    frames = np.ones((2, 20, 30), dtype)
    assert lb.read_recording(frames, detector=detector).full_scale_dn == full


def test_of_light_without_a_full_scale_it_is_the_largest_number():
    frames = np.ones((2, 20, 30), np.float32)
    assert lb.read_recording(frames).full_scale_dn == np.finfo(np.float32).max
    well = lb.Detector(full_well_e=500.7)
    assert lb.read_recording(frames, detector=well).full_scale_dn == 500.0


# Rows of a stamp


def test_some_rows_are_those_of_whole_frames_one_band_below_the_other():
    frames = RNG.integers(0, 900, (4, 20, 30)).astype(np.uint16)
    bad = np.zeros((20, 30), bool)
    bad[4, 7] = bad[15, 3] = bad[10, 10] = True
    stamp = lb.read_recording(frames, bad_pixels=bad).stamps[0]
    spans = [(2, 6), (14, 17)]
    found = stamp.read(1, 3, skip=False, spans=spans).frames
    expected = np.where(bad, np.nan, frames[1:3])
    expected = np.concatenate([expected[:, 2:6], expected[:, 14:17]], axis=1)
    np.testing.assert_array_equal(found, expected)
    plain = lb.read_recording(frames).stamps[0].frames
    bare = SimpleNamespace(
        read=plain.read, shape=plain.shape, dtype=plain.dtype, bad=None, name="a"
    )
    one = Stamp("frame", bare)
    np.testing.assert_array_equal(
        one.read(1, 3, skip=False, spans=spans).frames,
        np.concatenate([frames[1:3, 2:6], frames[1:3, 14:17]], axis=1),
    )
    assert one.label(2) == "frame 2 of a" and one.shape == (20, 30)


def test_what_is_left_out_or_unreadable_is_not_good():
    frames = RNG.integers(0, 900, (4, 20, 30)).astype(np.uint16)
    plain = lb.read_recording(frames).stamps[0].frames

    def read(i, j, out=None):
        if i <= 2 < j:
            raise lb.UnreadableFrame("frame 2 is damaged")
        return plain.read(i, j, out)

    bare = SimpleNamespace(
        read=read,
        shape=plain.shape,
        dtype=plain.dtype,
        bad=None,
        name="a",
        left_out=np.array([True, False, False, False]),
    )
    stamp = replace(Stamp("frame", bare))
    block = stamp.read(0, 4, skip=True)
    assert block.good.tolist() == [False, True, False, True]
    assert block.skipped == {2: "frame 2 is damaged"}
    np.testing.assert_array_equal(block.frames[[0, 1, 3]], frames[[0, 1, 3]])
    assert not block.frames[2].any()
    part = stamp.read(1, 4, skip=True)
    assert part.good.tolist() == [True, False, True] and list(part.skipped) == [2]
    with pytest.raises(lb.UnreadableFrame, match="frame 2 is damaged"):
        stamp.read(1, 4, skip=False)
