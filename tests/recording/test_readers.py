"""Every format gives the same frames back; every broken file is named."""

import cv2
import numpy as np
import pytest

import losbench as lb
from losbench.recording.stamps import UnreadableFrame

FRAMES = np.random.default_rng(7).integers(0, 60_000, (12, 20, 30)).astype(np.uint16)


def images(folder, frames, suffix=".tif"):
    folder.mkdir()
    for k, frame in enumerate(frames):
        assert cv2.imwrite(str(folder / f"frame-{k}{suffix}"), frame)
    return folder


def every_frame(recording):
    block = recording.stamps[0].read(0, recording.n_frames, skip=recording.skip_unreadable)
    return block.frames, block.good


@pytest.mark.parametrize("suffix", [".png", ".tif", ".tiff"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_a_folder_of_images_comes_back_in_natural_order(tmp_path, suffix, dtype):
    frames = (FRAMES >> 8).astype(dtype)
    recording = lb.read_recording(images(tmp_path / "frames", frames, suffix))
    stack, good = every_frame(recording)
    assert stack.dtype == dtype and good.all()
    np.testing.assert_array_equal(stack, frames)


def test_stacks_in_one_file_come_back(tmp_path):
    cv2.imwritemulti(str(tmp_path / "pages.tif"), list(FRAMES))
    np.save(tmp_path / "stack.npy", FRAMES)
    np.savez_compressed(tmp_path / "stack.npz", other=np.zeros(3), frames=FRAMES)
    for name in ("pages.tif", "stack.npy", "stack.npz"):
        np.testing.assert_array_equal(every_frame(lb.read_recording(tmp_path / name))[0], FRAMES)


def test_a_fits_cube_comes_back_in_native_order(tmp_path):
    fits = pytest.importorskip("astropy.io.fits")
    fits.PrimaryHDU(FRAMES.astype(">f4")).writeto(tmp_path / "cube.fits")
    stack, _ = every_frame(lb.read_recording(tmp_path / "cube.fits"))
    assert stack.dtype == np.float32 and stack.dtype.isnative
    np.testing.assert_array_equal(stack, FRAMES)


def test_frames_stay_on_disk_until_asked_for(tmp_path):
    folder = images(tmp_path / "frames", FRAMES)
    recording = lb.read_recording(folder)
    cv2.imwrite(str(folder / "frame-5.tif"), FRAMES[0])
    np.testing.assert_array_equal(recording.stamps[0].read(5, 6, skip=False).frames[0], FRAMES[0])


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_a_truncated_image_is_named_and_stops_or_is_skipped(tmp_path, suffix):
    folder = images(tmp_path / "frames", FRAMES, suffix)
    broken = folder / f"frame-3{suffix}"
    broken.write_bytes(broken.read_bytes()[:200])
    with pytest.raises(
        UnreadableFrame, match=rf"frame-3\{suffix} cannot be read: not an image, or cut short"
    ):
        every_frame(lb.read_recording(folder))
    stack, good = every_frame(lb.read_recording(folder, on_unreadable="skip"))
    assert not good[3] and good.sum() == len(FRAMES) - 1
    np.testing.assert_array_equal(stack[4], FRAMES[4])


def test_mixed_frame_sizes_are_named(tmp_path):
    folder = images(tmp_path / "frames", FRAMES)
    cv2.imwrite(str(folder / "frame-4.tif"), FRAMES[0, :10])
    expected = r"all frames must be 20x30 uint16 as frame-0.tif, but frame-4.tif is 10x30 uint16"
    with pytest.raises(UnreadableFrame, match=expected):
        every_frame(lb.read_recording(folder))


def test_a_colour_image_is_refused(tmp_path):
    folder = tmp_path / "colour"
    folder.mkdir()
    cv2.imwrite(str(folder / "a.png"), np.arange(192, dtype=np.uint8).reshape(8, 8, 3))
    with pytest.raises(
        ValueError, match=r"a.png must be one grey image \(rows, cols\), got 3 colour channels"
    ):
        lb.read_recording(folder)


def test_what_is_no_recording_is_refused_by_name(tmp_path):
    with pytest.raises(
        FileNotFoundError, match="no recording at .*nowhere: expected a folder of images"
    ):
        lb.read_recording(tmp_path / "nowhere")
    (tmp_path / "notes.txt").write_text("hello")
    with pytest.raises(
        ValueError,
        match=r"holds no frames: expected PNG, TIFF or FITS files or the like, got 1 other",
    ):
        lb.read_recording(tmp_path)
    with pytest.raises(
        ValueError, match=r"notes.txt is no recording: expected a folder of images, or a TIFF, .npy"
    ):
        lb.read_recording(tmp_path / "notes.txt")
    np.save(tmp_path / "flat.npy", FRAMES[0])
    with pytest.raises(
        ValueError, match=r"flat.npy must hold a stack \(frames, rows, cols\), got shape \(20, 30\)"
    ):
        lb.read_recording(tmp_path / "flat.npy")
    np.save(tmp_path / "empty.npy", FRAMES[:0])
    with pytest.raises(ValueError, match=r"empty.npy holds no frames"):
        lb.read_recording(tmp_path / "empty.npy")
    np.save(tmp_path / "cut.npy", FRAMES)
    (tmp_path / "cut.npy").write_bytes((tmp_path / "cut.npy").read_bytes()[:-20])
    with pytest.raises(UnreadableFrame, match=r"cut.npy is cut short after frame 11 of 12: skip"):
        lb.read_recording(tmp_path / "cut.npy")
    kept = lb.read_recording(tmp_path / "cut.npy", on_unreadable="skip")
    np.testing.assert_array_equal(every_frame(kept)[0], FRAMES[:11])
    (tmp_path / "cut.npy").write_bytes((tmp_path / "cut.npy").read_bytes()[:60])
    with pytest.raises(UnreadableFrame, match=r"cut.npy cannot be read"):
        lb.read_recording(tmp_path / "cut.npy")
    np.savez(tmp_path / "whole.npz", frames=FRAMES)
    (tmp_path / "cut.npz").write_bytes((tmp_path / "whole.npz").read_bytes()[:-200])
    with pytest.raises(UnreadableFrame, match=r"cut.npz cannot be read"):
        lb.read_recording(tmp_path / "cut.npz")
    (tmp_path / "cut.tif").write_bytes(b"II*\0")
    with pytest.raises(UnreadableFrame, match=r"cut.tif cannot be read: not a TIFF, or cut short"):
        lb.read_recording(tmp_path / "cut.tif")
    with pytest.raises(ValueError, match=r"on_unreadable must be one of 'stop', 'skip', got 'ask'"):
        lb.read_recording(tmp_path / "flat.npy", on_unreadable="ask")
    with pytest.raises(ValueError, match=r"period_s must be positive, got -5"):
        lb.read_recording(images(tmp_path / "frames", FRAMES[:1]), period_s=-5.0)


def test_a_multi_page_tiff_cut_in_half_is_named_or_ends_early(tmp_path):
    path = tmp_path / "pages.tif"
    cv2.imwritemulti(str(path), list(FRAMES))
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(UnreadableFrame, match=r"pages.tif is cut short after page \d"):
        lb.read_recording(path)
    kept = lb.read_recording(path, on_unreadable="skip")
    assert 0 < kept.n_frames < len(FRAMES)
    assert kept.notes == (
        f"pages.tif is cut short after page {kept.n_frames}: what came after is lost.",
    )
    path.write_bytes(whole)
    assert lb.read_recording(path, on_unreadable="skip").notes == ()


def test_a_gap_in_the_numbers_of_the_names_is_told_unless_times_are_given(tmp_path):
    folder = images(tmp_path / "frames", FRAMES)
    assert lb.read_recording(folder, period_s=5.0).notes == ()
    (folder / "frame-7.tif").unlink()
    (note,) = lb.read_recording(folder, period_s=5.0).notes
    assert note.startswith("File names jump from frame-6.tif to frame-8.tif: if frames are missing")
    (folder / "frame-9.tif").unlink()
    assert "to frame-8.tif, the first of 2 jumps:" in lb.read_recording(folder).notes[0]
    times = tmp_path / "times.csv"
    times.write_text("time_s\n" + "".join(f"{k}\n" for k in range(10)))
    assert lb.read_recording(folder, times=times).notes == ()


@pytest.mark.parametrize(
    "names",
    [
        ["10", "20", "30"],
        ["a-1000", "a-1005", "a-1011"],
        ["3-1", "4-7", "9-9"],
        ["x", "y", "z"],
        ["1", "b", "2-2"],
    ],
)
def test_numbers_that_do_not_count_frames_have_no_gap(tmp_path, names):
    for name in names:
        cv2.imwrite(str(tmp_path / f"{name}.tif"), FRAMES[0])
    assert lb.read_recording(tmp_path, period_s=5.0).notes == ()


def test_a_bad_first_frame_can_be_skipped(tmp_path):
    folder = images(tmp_path / "frames", FRAMES)
    (folder / "frame-0.tif").write_bytes(b"no image")
    _, good = every_frame(lb.read_recording(folder, on_unreadable="skip"))
    assert np.flatnonzero(~good).tolist() == [0]


def test_a_folder_of_fits_images_has_their_times(tmp_path):
    fits = pytest.importorskip("astropy.io.fits")
    for k, frame in enumerate(FRAMES[:3]):
        hdu = fits.PrimaryHDU(frame)
        hdu.header["DATE-OBS"] = f"2026-03-01T12:00:{5 * k:02d}"
        hdu.writeto(tmp_path / f"{k}.fits")
    recording = lb.read_recording(tmp_path)
    np.testing.assert_array_equal(every_frame(recording)[0], FRAMES[:3])
    assert recording.times.seconds.tolist() == [0, 5, 10]
    given = lb.read_recording(tmp_path, period_s=1.0, start="2026-04-01T12:00:00Z")
    assert given.times.seconds.tolist() == [0, 1, 2]
    assert given.times.start == np.datetime64("2026-04-01T12:00:00")
    with pytest.raises(ValueError, match="start goes with period_s"):
        lb.read_recording(tmp_path, start="2026-04-01T12:00:00Z")


def fits_folder(folder, headers, *, extension=False):
    fits = pytest.importorskip("astropy.io.fits")
    for k, header in enumerate(headers):
        primary = fits.PrimaryHDU(None if extension else FRAMES[k])
        primary.header.update(header)
        image = [fits.ImageHDU(FRAMES[k])] if extension else []
        fits.HDUList([primary, *image]).writeto(folder / f"{k}.fits")
    return folder


def test_the_time_of_day_may_stand_beside_the_date(tmp_path):
    headers = [{"DATE-OBS": "2026-03-01", "TIME-OBS": f"12:00:{5 * k:02d}.5"} for k in range(3)]
    times = lb.read_recording(fits_folder(tmp_path, headers)).times
    assert times.seconds.tolist() == [0, 5, 10]
    assert times.start == np.datetime64("2026-03-01T12:00:00.500")


def test_the_date_may_stand_in_the_primary_header(tmp_path):
    headers = [{"DATE-OBS": f"2026-03-01T12:00:{5 * k:02d}"} for k in range(3)]
    recording = lb.read_recording(fits_folder(tmp_path, headers, extension=True))
    assert recording.times.seconds.tolist() == [0, 5, 10]
    np.testing.assert_array_equal(every_frame(recording)[0], FRAMES[:3])


def test_a_file_without_a_time_is_named(tmp_path):
    headers = [
        {},
        {"DATE-OBS": "2026-03-01T12:00:05"},
        {"DATE-OBS": "2026-03-01"},
        {"DATE-OBS": "2026-03-01T12:00:15"},
    ]
    recording = lb.read_recording(fits_folder(tmp_path, headers))
    np.testing.assert_array_equal(recording.times.seconds, [np.nan, 0, np.nan, 10])
    said = (
        "2 of 4 files have no DATE-OBS with a time of day, first 0.fits: their times are unknown."
    )
    assert recording.notes == (said,)
    assert lb.read_recording(tmp_path, period_s=1.0).notes == ()


def test_times_of_fits_files_must_increase_unless_others_are_given(tmp_path):
    folder = fits_folder(
        tmp_path, [{"DATE-OBS": f"2026-03-01T12:00:{s}"} for s in ("10", "05", "20")]
    )
    with pytest.raises(
        ValueError, match="DATE-OBS of .* must hold increasing times, one for each frame in order"
    ):
        lb.read_recording(folder)
    assert lb.read_recording(folder, period_s=2.0).times.seconds.tolist() == [0, 2, 4]


def test_an_unreadable_fits_file_is_skipped(tmp_path):
    folder = fits_folder(tmp_path, [{"DATE-OBS": f"2026-03-01T12:00:0{k}"} for k in range(3)])
    (folder / "0.fits").write_bytes(b"no FITS")
    with pytest.raises(UnreadableFrame, match=r"0.fits cannot be read"):
        lb.read_recording(folder)
    recording = lb.read_recording(folder, on_unreadable="skip")
    np.testing.assert_array_equal(recording.times.seconds, [np.nan, 0, 1])
    assert every_frame(recording)[1].tolist() == [False, True, True]
    (folder / "2.fits").unlink()
    assert every_frame(recording)[1].tolist() == [False, True, False]
    with pytest.raises(UnreadableFrame, match=r"^2.fits cannot be read: .*No such file"):
        recording.stamps[0].load(2)


def test_alike_images_of_one_fits_file_are_frames_and_others_are_told(tmp_path):
    fits = pytest.importorskip("astropy.io.fits")
    extensions = [fits.ImageHDU(frame) for frame in FRAMES[:4]]
    for k, extension in enumerate(extensions):
        extension.header["DATE-OBS"] = f"2026-03-01T12:00:0{k}"
    fits.HDUList([fits.PrimaryHDU(), *extensions]).writeto(tmp_path / "alike.fits")
    recording = lb.read_recording(tmp_path / "alike.fits")
    np.testing.assert_array_equal(every_frame(recording)[0], FRAMES[:4])
    assert recording.times.seconds.tolist() == [0, 1, 2, 3]
    assert recording.notes == ("The 4 images of alike.fits are taken as frames.",)
    fits.HDUList([fits.PrimaryHDU(FRAMES[0]), fits.ImageHDU(FRAMES[0, :5])]).writeto(
        tmp_path / "mixed.fits"
    )
    mixed = lb.read_recording(tmp_path / "mixed.fits")
    assert mixed.n_frames == 1 and mixed.notes == (
        "mixed.fits holds 2 images: only the first is measured.",
    )
    fits.HDUList([fits.PrimaryHDU(FRAMES), fits.ImageHDU(FRAMES)]).writeto(tmp_path / "cubes.fits")
    cubes = lb.read_recording(tmp_path / "cubes.fits")
    assert cubes.n_frames == 12 and cubes.notes == (
        "cubes.fits holds 2 images: only the first is measured.",
    )


def test_a_fits_cube_may_tell_its_times(tmp_path):
    fits = pytest.importorskip("astropy.io.fits")
    hdu = fits.PrimaryHDU(FRAMES[:4])
    hdu.header.update({"CTYPE3": "TIME", "CRVAL3": 100.0, "CDELT3": 2.0, "CRPIX3": 1.0})
    hdu.writeto(tmp_path / "cube.fits")
    assert lb.read_recording(tmp_path / "cube.fits").times.seconds.tolist() == [100, 102, 104, 106]


def test_options_that_say_nothing_are_refused(tmp_path):
    np.save(tmp_path / "stack.npy", FRAMES)
    with pytest.raises(ValueError, match="start goes with period_s"):
        lb.read_recording(tmp_path / "stack.npy", start="2026-03-01T12:00:00Z")
    with pytest.raises(ValueError, match="times and period_s exclude each other"):
        lb.read_recording(tmp_path / "stack.npy", period_s=1.0, times="times.csv")
