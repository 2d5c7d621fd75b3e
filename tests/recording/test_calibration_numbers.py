"""What calibrated frames promise, from either side: what saturates, what is bad, what is refused."""

import numpy as np
import pytest

import losbench as lb

RNG = np.random.default_rng(41)
FRAMES = RNG.integers(100, 200, (3, 6, 8)).astype(np.uint16)
DARK = RNG.uniform(20.0, 60.0, (6, 8))
FLAT = RNG.uniform(0.7, 1.3, (6, 8))
WELL = lb.Detector(full_well_e=500.7, bits=10)


def opened(frames=FRAMES, **options):
    return lb.read_recording(frames, period_s=1.0, **options)


def everything(recording):
    return recording.stamps[0].read(0, recording.n_frames, skip=False).frames


# Full scale


@pytest.mark.parametrize(
    ("dtype", "detector", "full"),
    [
        (np.uint8, lb.Detector(bits=16), 255),
        (np.uint8, None, 255),
        (np.uint16, lb.Detector(bits=10), 1023),
        (np.uint16, WELL, 500),
        (np.float32, WELL, 500),
    ],
)
@pytest.mark.parametrize("changed", [("dark",), ("flat",), ("dark", "flat")])
def test_what_saturates_first_reads_the_same_in_every_pixel(dtype, detector, full, changed):
    """The end of the file's numbers, or the whole number below the detector's full scale."""
    images = {"dark": DARK, "flat": FLAT}
    frames = FRAMES.astype(dtype)
    frames[1, 2:4], frames[2, 2:4] = full, full - 1
    recording = opened(frames, detector=detector, **{name: images[name] for name in changed})
    dark = DARK if "dark" in changed else 0.0 * DARK
    flat = FLAT / FLAT.mean() if "flat" in changed else 0.0 * FLAT + 1.0
    top = ((full - dark) / flat).max()
    assert recording.full_scale_dn == pytest.approx(top, rel=1e-6)
    stack = everything(recording)
    assert (stack[1, 2:4] == recording.full_scale_dn).all()
    np.testing.assert_allclose(stack[2], (frames[2] - dark) / flat, rtol=1e-5)
    assert (stack[[0, 2]] < recording.full_scale_dn).all()


def test_light_without_a_full_scale_is_calibrated_however_bright():
    frames = FRAMES.astype(np.float32)
    frames[1] = 1e9
    recording = opened(frames, dark=DARK)
    assert recording.stamps[0].frames.full_scale_dn is None
    np.testing.assert_allclose(everything(recording)[1], 1e9 - DARK, rtol=1e-6)


def test_a_region_alone_changes_no_number():
    recording = opened(roi=(2, 1, 6, 5))
    frames = recording.stamps[0].frames
    assert frames.dtype == np.uint16 and frames.full_scale_dn == 65535 and frames.bad is None
    np.testing.assert_array_equal(everything(recording), FRAMES[:, 1:6, 2:8])
    assert recording.notes == () and recording.stamps[0].whole == (6, 8)


def test_a_region_alone_cuts_no_reading_off():
    """The detector's full scale is told, and what reads more stays as it was."""
    frames = FRAMES.copy()
    frames[0, 0, 0] = 5000
    recording = opened(frames, roi=(0, 0, 8, 6), detector=lb.Detector(bits=10))
    assert recording.full_scale_dn == 1023
    np.testing.assert_array_equal(everything(recording), frames)


# Several darks, and darks of another step


@pytest.mark.parametrize("n", [1, 15, 16, 17, 33])
def test_a_dark_of_several_frames_is_their_mean(tmp_path, n):
    darks = RNG.integers(0, 90, (n, 6, 8)).astype(np.uint16)
    np.save(tmp_path / "dark.npy", darks)
    for dark in (darks, tmp_path / "dark.npy"):
        expected = FRAMES - darks.mean(axis=0)
        np.testing.assert_allclose(everything(opened(dark=dark)), expected, rtol=1e-6)


def test_a_dark_of_few_codes_counts_in_the_steps_of_the_frames():
    """Left-aligned frames are divided by 16, and so is a dark that does not show it."""
    frames = 16 * RNG.integers(100, 900, (2, 60, 80)).astype(np.uint16)
    dark = np.full((2, 60, 80), 160, np.uint16)
    recording = opened(frames, dark=dark)
    np.testing.assert_allclose(everything(recording), frames / 16.0 - 10.0)


def test_darks_and_masks_need_no_times_that_increase(tmp_path):
    """Files of one second, and of darks taken in any order."""
    fits = pytest.importorskip("astropy.io.fits")
    for name, value in (("dark", 10), ("bad", 0)):
        (tmp_path / name).mkdir()
        for k in range(2):
            hdu = fits.PrimaryHDU(np.full((6, 8), value + 2 * k, np.int16))
            hdu.header["DATE-OBS"] = "2026-03-01T12:00:00"
            hdu.writeto(tmp_path / name / f"{k}.fits")
    recording = opened(dark=tmp_path / "dark", bad_pixels=tmp_path / "bad")
    np.testing.assert_allclose(everything(recording), FRAMES - 11.0)


# Bad pixels


def bad_of(recording):
    return np.argwhere(np.isnan(everything(recording)[0])).tolist()


@pytest.mark.parametrize("value", [0.0, -0.5, np.nan])
def test_a_flat_is_above_zero_or_its_pixel_is_bad_and_takes_no_part_in_the_mean(value):
    flat = FLAT.copy()
    flat[3, 4] = value
    recording = opened(flat=flat)
    assert bad_of(recording) == [[3, 4]]
    good = np.ones((6, 8), bool)
    good[3, 4] = False
    expected = FRAMES[:, good] / (flat[good] / flat[good].mean())
    np.testing.assert_allclose(everything(recording)[:, good], expected, rtol=1e-5)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_dark_that_is_no_number_makes_a_bad_pixel_and_spoils_no_other(value):
    dark = DARK.copy()
    dark[3, 4] = value
    recording = opened(dark=dark, flat=FLAT)
    assert bad_of(recording) == [[3, 4]]
    assert np.isfinite(recording.full_scale_dn)
    assert recording.notes[-1] == "1 pixels are bad, and left out."


def test_a_flat_without_a_good_pixel_is_refused_and_with_one_is_not():
    flat = np.zeros((6, 8))
    with pytest.raises(ValueError, match="flat must be above zero"):
        opened(flat=flat)
    flat[2, 2] = 5.0
    np.testing.assert_array_equal(everything(opened(flat=flat))[:, 2, 2], FRAMES[:, 2, 2])


def test_bad_pixels_of_the_files_and_those_given_add_up(tmp_path):
    fits = pytest.importorskip("astropy.io.fits")
    mask = np.zeros((6, 8), np.int16)
    mask[1, 1] = 4
    hdus = [fits.PrimaryHDU(FRAMES), fits.ImageHDU(mask, name="DQ")]
    fits.HDUList(hdus).writeto(tmp_path / "a.fits")
    given = np.zeros((6, 8), bool)
    given[2, 5] = True
    recording = opened(tmp_path / "a.fits", bad_pixels=given)
    assert bad_of(recording) == [[1, 1], [2, 5]]
    assert bad_of(opened(tmp_path / "a.fits", roi=(0, 0, 8, 6))) == [[1, 1]]
    assert recording.notes[-1] == "2 pixels are bad, and left out."


@pytest.mark.parametrize(("place", "inside"), [
    ((0, 0), True),
    ((7, 5), True),
    ((8, 0), False),
    ((0, 6), False),
    ((-1, 0), False),
    ((0, -1), False),
    ((2.5, 1), False),
])  # fmt: skip
def test_bad_pixels_are_whole_places_inside_the_frame(place, inside):
    given = np.array([(1, 1), place, (3, 2)], float)
    if inside:
        x, y = place
        assert bad_of(opened(bad_pixels=given)) == sorted([[1, 1], [y, x], [2, 3]])
    else:
        with pytest.raises(ValueError, match="whole pixels .* 6x8 frame, got ") as told:
            opened(bad_pixels=given)
        first = place if place != (2.5, 1) else (1, 1)
        assert str(told.value).endswith(f"got {[list(map(float, first))]}")


def test_of_frames_two_columns_wide_a_mask_is_a_mask():
    frames = RNG.integers(100, 900, (2, 5, 2)).astype(np.uint16)
    mask = np.zeros((5, 2), int)
    mask[3, 1] = 1
    assert bad_of(opened(frames, bad_pixels=mask)) == [[3, 1]]
    assert bad_of(opened(frames, bad_pixels=[[1, 4]])) == [[4, 1]]
    with pytest.raises(ValueError, match=r"bad_pixels must have the shape of the frames, \(5, 2\)"):
        opened(frames, bad_pixels=np.zeros((5, 3)))
    with pytest.raises(
        ValueError, match=r"^bad_pixels must mark pixels by what is not 0, got NaN$"
    ):
        opened(frames, bad_pixels=np.where(mask, np.nan, 1.0))


def test_a_mask_may_be_an_image_or_an_array_on_disk(tmp_path):
    import cv2

    mask = np.zeros((6, 8), np.uint8)
    mask[4, 7] = 255
    assert cv2.imwrite(str(tmp_path / "mask.png"), mask)
    np.save(tmp_path / "mask.npy", mask)
    np.save(tmp_path / "places.npy", np.array([[7, 4]]))
    for name in ("mask.png", "mask.npy", "places.npy"):
        assert bad_of(opened(bad_pixels=tmp_path / name)) == [[4, 7]]


def test_an_array_of_no_numbers_is_refused(tmp_path):
    np.save(tmp_path / "dark.npy", np.full((6, 8), "a"))
    with pytest.raises(lb.UnreadableFrame, match="dark.npy cannot be read: must hold numbers"):
        opened(dark=tmp_path / "dark.npy")
    np.save(tmp_path / "bad.npy", np.ones((6, 8), bool))
    assert len(bad_of(opened(bad_pixels=tmp_path / "bad.npy"))) == 48


# The region


@pytest.mark.parametrize(("roi", "inside"), [
    ((0, 0, 8, 6), True),
    ((3, 2, 5, 4), True),
    ((7, 5, 1, 1), True),
    ((3, 2, 6, 4), False),
    ((3, 2, 5, 5), False),
    ((0, 0, 0, 3), False),
    ((0, 0, 3, 0), False),
])  # fmt: skip
def test_a_region_ends_within_the_frame_and_holds_a_pixel(roi, inside):
    if inside:
        x, y, columns, rows = roi
        recording = opened(roi=roi)
        np.testing.assert_array_equal(
            everything(recording), FRAMES[:, y : y + rows, x : x + columns]
        )
        assert recording.stamps[0].origin_px == (x, y)
    else:
        with pytest.raises(ValueError, match="roi must lie inside the 6x8 frame"):
            opened(roi=roi)


@pytest.mark.parametrize("roi", [(-1, 0, 3, 3), (0, -1, 3, 3), (0, 0, 2.5, 3)])
def test_a_region_is_of_whole_numbers_from_zero(roi):
    with pytest.raises(ValueError, match="roi must be"):
        opened(roi=roi)


def test_without_a_calibration_frames_are_not_wrapped():
    assert "Calibrated" not in type(opened().stamps[0].frames).__name__
    assert "Calibrated" in type(opened(dark=DARK).stamps[0].frames).__name__
