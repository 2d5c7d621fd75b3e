"""One door: folders, patterns, several files, readers of one's own; times in names; calibration; what does not belong
is named.
"""

import pickle
from dataclasses import dataclass, field, replace
from importlib import metadata

import cv2
import files_of_frames as write
import numpy as np
import pytest

import losbench as lb
from losbench.cli import main
from losbench.recording.frames import door
from losbench.recording.frames.names import times_in_names

FRAMES = np.random.default_rng(7).integers(100, 900, (12, 20, 30)).astype(np.uint16)


def named(folder, names, frames=FRAMES):
    folder.mkdir(exist_ok=True)
    for name, frame in zip(names, frames, strict=False):
        assert cv2.imwrite(str(folder / name), frame)
    return folder


def everything(recording):
    return recording.stamps[0].read(0, recording.n_frames, skip=recording.skip_unreadable).frames


# What is opened


def test_patterns_and_lists_come_in_natural_order(tmp_path):
    folder = named(tmp_path / "f", [f"a-{k}.png" for k in range(12)])
    named(folder, [f"b-{k}.png" for k in range(12)], FRAMES + 1)
    for path in (folder / "a-*.png", str(folder / "a-*.png"), sorted(folder.glob("a-*.png"))):
        np.testing.assert_array_equal(everything(lb.read_recording(path)), FRAMES)
    with pytest.raises(FileNotFoundError, match=r"no recording at .*c-\*.png"):
        lb.read_recording(folder / "c-*.png")
    with pytest.raises(ValueError, match="path must name at least one file, got none"):
        lb.read_recording([])


def test_two_series_in_one_folder_are_not_mixed(tmp_path):
    folder = named(tmp_path / "f", [f"a-{k}.png" for k in range(6)])
    named(folder, [f"b-{k}.png" for k in range(6)])
    with pytest.raises(
        ValueError,
        match=r"f holds more than one series, a-#.png \(6 files\), b-#.png \(6 files\): choose one, as in f/a-\*.png",
    ):
        lb.read_recording(folder)


def test_what_does_not_belong_is_left_out_and_named(tmp_path):
    folder = named(tmp_path / "f", [f"a-{k}.png" for k in range(12)])
    named(folder, ["dark.png", "preview_a-3.png"], np.zeros((2, 5, 5), np.uint16))
    (folder / "times.csv").write_text("time_s\n")
    recording = lb.read_recording(folder)
    np.testing.assert_array_equal(everything(recording), FRAMES)
    assert recording.notes == (
        "2 of 14 files do not belong to a-#.png and are left out: dark.png, preview_a-3.png.",
    )


def test_files_of_two_kinds_are_refused_and_stacks_are_joined(tmp_path):
    np.save(tmp_path / "part-1.npy", FRAMES[:5])
    np.save(tmp_path / "part-10.npy", FRAMES[9:])
    np.save(tmp_path / "part-2.npy", FRAMES[5:9])
    recording = lb.read_recording(tmp_path, period_s=1.0)
    assert recording.n_frames == 12
    np.testing.assert_array_equal(everything(recording), FRAMES)
    assert [recording.label(k) for k in (4, 5, 11)] == [
        "frame 4 of part-1.npy",
        "frame 0 of part-2.npy",
        "frame 2 of part-10.npy",
    ]
    cv2.imwrite(str(tmp_path / "a.png"), FRAMES[0])
    with pytest.raises(ValueError, match="must hold files of one kind, got a.png, part-1.npy"):
        lb.read_recording([tmp_path / "part-1.npy", tmp_path / "a.png"])


def test_the_table_names_file_and_page_of_every_frame(tmp_path):
    light = lb.render_spots([[15.0, 10.0]], 5e4, 1.5, (20, 30)) + 100
    frames = np.random.default_rng(1).poisson(np.repeat(light[None], 3, axis=0)).astype(np.uint16)
    for path, expected in (
        (
            named(tmp_path / "f", [f"{k}.png" for k in range(3)], frames),
            ["0.png", "1.png", "2.png"],
        ),
        (write.tiff16(tmp_path / "a.tif", frames), [f"page {k} of a.tif" for k in range(3)]),
    ):
        assert (
            lb.measure(lb.read_recording(path), spots=[[15, 10]]).table["source"].tolist()
            == expected
        )


# Times in names


def test_times_stand_in_names(tmp_path):
    names = [f"cam1_20260301_1200{s:02d}.png" for s in (0, 5, 10)]
    recording = lb.read_recording(named(tmp_path / "f", names), name_times="%Y%m%d_%H%M%S")
    assert recording.times.seconds.tolist() == [0, 5, 10]
    assert recording.times.start == np.datetime64("2026-03-01T12:00:00")
    assert recording.notes == (
        "Times in the files' names are taken as UTC (--name-utc-offset says otherwise).",
    )
    with pytest.raises(
        ValueError,
        match="name_times must fit the name of every file: cam1_20260301_120000.png has no x%j",
    ):
        lb.read_recording(tmp_path / "f", name_times="x%j")
    with pytest.raises(ValueError, match="name_times must be a pattern of %Y"):
        lb.read_recording(tmp_path / "f", name_times="%Q")
    with pytest.raises(
        ValueError, match="times and period_s exclude each other, and name_times both"
    ):
        lb.read_recording(tmp_path / "f", name_times="%Y", period_s=1.0)
    named(tmp_path / "f", ["cam1_20260301_120003_.png"])
    with pytest.raises(ValueError, match="name_times is for files of one frame each"):
        lb.read_recording(FRAMES, name_times="%Y")


def test_fractions_and_offsets_in_names_are_understood():
    times = times_in_names(
        ["t2026-03-01T13.00.00.250+0100", "t2026-03-01T13.00.01.5+0100"], "%Y-%m-%dT%H.%M.%S.%f%z"
    )
    assert times.seconds.tolist() == [0, 1.25]
    assert times.start == np.datetime64("2026-03-01T12:00:00.250")


@pytest.mark.parametrize(("offset", "utc"), [(1, "11"), ("-3.5", "15"), ("Europe/Berlin", "10")])
def test_local_times_in_names_have_an_offset(tmp_path, offset, utc):
    """Berlin keeps summer time in July."""
    names = [f"20260701_12{m:02d}00.png" for m in range(3)]
    folder = named(tmp_path / "f", names)
    recording = lb.read_recording(folder, name_times="%Y%m%d_%H%M%S", utc_offset=offset)
    minutes = "30" if offset == "-3.5" else "00"
    assert recording.times.start == np.datetime64(f"2026-07-01T{utc}:{minutes}:00")
    assert recording.notes == ()
    with pytest.raises(ValueError, match="utc_offset goes with name_times"):
        lb.read_recording(folder, utc_offset=1)
    with pytest.raises(ValueError, match="utc_offset must be"):
        lb.read_recording(folder, name_times="%Y%m%d_%H%M%S", utc_offset="Nowhere/Town")


# Readers of one's own


@dataclass(frozen=True)
class Mine:
    """The least that frames need."""

    name: str = "mine"
    shape: tuple = (20, 30)
    dtype: np.dtype = field(default_factory=lambda: np.dtype(np.uint16))
    n_frames: int = 12
    time_s: None = None
    start: None = None
    detector: None = None
    bad: None = None
    step: int = 1
    full_scale_dn: None = None

    def read(self, i, j, out=None):
        block = np.empty((j - i, *self.shape), np.uint16) if out is None else out[: j - i]
        block[:] = FRAMES[i:j]
        return block


@pytest.fixture
def readers(monkeypatch):
    monkeypatch.setattr(door, "_registered", [])
    door._installed.cache_clear()
    yield
    door._installed.cache_clear()


def test_a_reader_of_one_s_own_comes_first(tmp_path, readers):
    (tmp_path / "a.tif").write_bytes(b"mine")
    lb.register_reader(lambda path: path.read_bytes()[:4] == b"mine", lambda path: Mine())
    recording = pickle.loads(pickle.dumps(lb.read_recording(tmp_path / "a.tif", period_s=2.0)))
    np.testing.assert_array_equal(everything(recording), FRAMES)
    assert recording.label(3) == "frame 3 of mine"
    roi = lb.read_recording(tmp_path / "a.tif", roi=(3, 4, 10, 8), dark=FRAMES[0])
    np.testing.assert_array_equal(
        roi.stamps[0].load(2), (FRAMES[2] - FRAMES[0].astype(float))[4:12, 3:13]
    )


def test_an_installed_reader_is_found(tmp_path, readers, monkeypatch):
    class Entry:
        @staticmethod
        def load():
            return (lambda path: path.suffix == ".mine", lambda path: Mine())

    monkeypatch.setattr(
        door, "entry_points", lambda group: [Entry] if group == "losbench.readers" else []
    )
    (tmp_path / "a.mine").write_bytes(b"")
    assert lb.open_frames(tmp_path / "a.mine").n_frames == 12
    assert metadata is not None


# Calibration


def test_dark_flat_bad_pixels_and_region_are_the_ordinary_calibration(tmp_path):
    rng = np.random.default_rng(3)
    dark, flat = rng.integers(50, 90, (20, 30)), rng.uniform(0.8, 1.2, (20, 30))
    flat[2, 3] = 0.0
    np.save(tmp_path / "dark.npy", np.stack([dark - 1, dark + 1]))
    np.save(tmp_path / "flat.npy", flat)
    (tmp_path / "bad.csv").write_text("x,y\n7,5\n0,19\n")
    bad = np.zeros((20, 30), bool)
    bad[5, 7] = bad[19, 0] = bad[2, 3] = True
    recording = lb.read_recording(
        FRAMES,
        dark=tmp_path / "dark.npy",
        flat=tmp_path / "flat.npy",
        bad_pixels=tmp_path / "bad.csv",
    )
    expected = (FRAMES - dark.astype(float)) / np.where(bad, 1.0, flat / flat[~bad].mean())
    got = everything(recording)
    np.testing.assert_array_equal(np.isnan(got), np.broadcast_to(bad, got.shape))
    np.testing.assert_allclose(got[:, ~bad], expected[:, ~bad], rtol=1e-6)
    assert recording.notes == (
        "Frames are calibrated: a dark was taken off and they were divided by a flat.",
        "3 pixels are bad, and left out.",
    )
    again = pickle.loads(pickle.dumps(recording))
    np.testing.assert_array_equal(everything(again), got)
    part = lb.read_recording(FRAMES, dark=dark, roi=(4, 3, 12, 9))
    assert part.stamps[0].shape == (9, 12) and part.stamps[0].origin_px == (4, 3)
    np.testing.assert_array_equal(everything(part), (FRAMES - dark.astype(float))[:, 3:12, 4:16])


def test_positions_of_a_region_are_those_of_the_detector():
    light = lb.render_spots([[40.3, 25.6], [52.2, 35.1]], 5e4, 1.5, (60, 80)) + 100
    frames = np.random.default_rng(1).poisson(np.repeat(light[None], 3, axis=0)).astype(np.uint16)
    camera = lb.Camera(focal_mm=260.0, pixel_um=5.5, shape=(60, 80))
    whole = lb.measure(lb.read_recording(frames), spots=[[40, 26], [52, 35]])
    part = lb.measure(
        lb.read_recording(frames, roi=(20, 10, 44, 37)),
        camera,
        spots=[[40, 26], [52, 35]],
    )
    np.testing.assert_allclose(part.xy_px, whole.xy_px, atol=1e-9)


def test_saturation_survives_calibration():
    rng = np.random.default_rng(3)
    frames = FRAMES.copy()
    frames[:, 8:11, 9:12] = 4095
    detector = lb.Detector(bits=12, offset_dn=60.0, gain_e_per_dn=2.0)
    flat = rng.uniform(0.7, 1.3, (20, 30))
    recording = lb.read_recording(
        frames, dark=np.full((20, 30), 60.0), flat=flat, detector=detector
    )
    stack = everything(recording)
    np.testing.assert_array_equal(stack >= recording.full_scale_dn, frames == 4095)
    assert recording.detector == replace(detector, offset_dn=0.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"dark": np.zeros((3, 3))},
            r"dark must have the shape of the frames, \(20, 30\), got \(3, 3\)",
        ),
        ({"flat": np.zeros((20, 30))}, "flat must be above zero"),
        (
            {"bad_pixels": np.array([[30, 2]])},
            r"bad_pixels must be whole pixels \(x, y\) inside the 20x30 frame",
        ),
        (
            {"roi": (0, 0, 31, 5)},
            "roi must lie inside the 20x30 frame, got x 0, y 0, 31 columns, 5 rows",
        ),
        ({"roi": (0, 0, 3)}, r"roi must be \(x, y, columns, rows\)"),
        (
            {"channel": "red"},
            "channel is for colour frames, but frame 0 of memory is grey",
        ),
    ],
)
def test_a_calibration_that_does_not_fit_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        lb.read_recording(FRAMES, **options)


def test_a_list_of_pixels_that_is_none_is_refused_by_line(tmp_path):
    (tmp_path / "bad.csv").write_text("x,y\n7,5\n3\n")
    with pytest.raises(
        ValueError, match="bad.csv must list one pixel x, y a line, got '3' in line 3"
    ):
        lb.read_recording(FRAMES, bad_pixels=tmp_path / "bad.csv")
    with pytest.raises(FileNotFoundError, match="no dark at"):
        lb.read_recording(FRAMES, dark=tmp_path / "none.npy")


# The command line


def test_colour_frames_are_measured_by_reading_messages(tmp_path, capsys):
    light = lb.render_spots([[15.0, 20.0], [60.0, 30.0]], 3e4, 1.5, (48, 80)) + 20
    grey = np.random.default_rng(1).poisson(np.repeat(light[None], 4, axis=0)).clip(0, 255)
    colour = np.stack([grey * 0.2, grey * 0.5, grey], axis=-1).astype(np.uint8)  # blue first
    folder = named(tmp_path / "frames", [f"cam_12000{k}.png" for k in range(4)], colour)
    command = ["measure", str(folder), "--out", str(tmp_path / "out"), "--quiet"]
    assert main(command) == 2
    said = capsys.readouterr().err
    assert (
        "cam_120000.png must be one grey image" in said
        and "--channel" in said
        and said.count("\n") == 1
    )
    assert main([*command, "--channel", "red", "--name-times", "%H%M%S"]) == 0
    assert (
        main([*command, "--force", "--channel", "0", "--roi", "2,2,70,44", "--dark", "nowhere.png"])
        == 2
    )
    assert "no recording at nowhere.png" in capsys.readouterr().err
    assert main([*command, "--force", "--channel", "0", "--roi", "2,2,70"]) == 2
    assert "--roi must be X,Y,COLUMNS,ROWS" in capsys.readouterr().err
