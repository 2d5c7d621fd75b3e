"""Whatever file the frames come in, the numbers are the same; what a file cannot say is not made up."""

import json
import pickle
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from files_of_frames import every_kind

import losbench as lb

pytest.importorskip("h5py")
pytest.importorskip("astropy")

DETECTOR = lb.Detector(gain_e_per_dn=4.0, read_noise_e=8.0, offset_dn=100.0, bits=12)
SPOTS = np.array([[20.3, 15.8], [48.1, 30.6]])


def twelve_bits(n=9):
    drift = np.linspace(0.0, 0.6, n)[:, None, None] * [1.0, -0.5]
    light = lb.render_spots(SPOTS + drift, 6e4, 1.7, (44, 66)) + 40.0
    return DETECTOR.expose(light, np.random.default_rng(4)).astype(np.uint16)


@pytest.fixture(scope="module")
def kinds(tmp_path_factory):
    return every_kind(tmp_path_factory.mktemp("kinds"), twelve_bits())


KINDS = [
    "png", "pgm", "lzw", "tiff", "bigtiff", "tiff12", "tiff-lzw-pages", "ser", "ser-big", "mono12", "mono12p",
    "mono12packed", "npy", "npy-big", "npy-fortran", "npz", "npz-stored", "fits", "fits.gz", "fits-many", "fits.fz",
    "hdf5", "hdf5-chunks",
]  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_every_format_gives_the_same_numbers_in_any_order_and_after_a_pickle(kinds, kind):
    truth = twelve_bits()
    recording = lb.read_recording(kinds[kind], period_s=1.0)
    frames = recording.stamps[0].frames
    assert (frames.n_frames, frames.shape, frames.dtype) == (9, (44, 66), np.uint16)
    np.testing.assert_array_equal(frames.read(0, 9), truth)
    np.testing.assert_array_equal(frames.read(8, 9)[0], truth[8])
    np.testing.assert_array_equal(frames.read(2, 3)[0], truth[2])
    room = np.empty((4, 44, 66), np.uint16)
    frames.read(3, 5, room)
    np.testing.assert_array_equal(room[:2], truth[3:5])
    packed = pickle.dumps(recording)
    again = pickle.loads(packed)
    np.testing.assert_array_equal(again.stamps[0].read(0, 9, skip=False).frames, truth)
    assert again.times.seconds.tolist() == recording.times.seconds.tolist()
    assert len(packed) < 5000


def test_every_format_gives_the_same_measurement_to_the_byte(kinds, tmp_path):
    times = tmp_path / "times.csv"
    times.write_text("time_s\n" + "".join(f"{5 * k}\n" for k in range(9)))
    camera = lb.Camera(focal_mm=260.0, pixel_um=5.5, shape=(44, 66))
    results = {}
    for kind in KINDS:
        recording = lb.read_recording(kinds[kind], times=times, detector=DETECTOR)
        measured = lb.measure(recording, camera, spots=SPOTS)
        arrays = measured.xy_px, measured.sigma_xy_px, measured.flags, measured.attitude.angles
        results[kind] = b"".join(array.tobytes() for array in arrays)
        assert np.isfinite(measured.attitude.angles).all()
    assert [kind for kind in KINDS if results[kind] != results["npy"]] == []


def test_another_process_reads_what_it_is_given(kinds, tmp_path):
    recordings = {kind: lb.read_recording(path) for kind, path in kinds.items()}
    recordings["calibrated"] = lb.read_recording(
        kinds["tiff"], roi=(3, 2, 40, 30), flat=np.ones((44, 66))
    )
    (tmp_path / "recordings").write_bytes(pickle.dumps(recordings))
    code = (
        "import pickle, sys, json; all = pickle.load(open(sys.argv[1], 'rb'));"
        "print(json.dumps({k: float(r.stamps[0].load(8).sum()) for k, r in all.items()}))"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "recordings")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    truth = twelve_bits()[8]
    expected = {kind: float(truth.sum()) for kind in kinds}
    assert json.loads(done.stdout) == expected | {"calibrated": float(truth[2:32, 3:43].sum())}


def test_threads_do_not_disturb_each_other(kinds):
    """More kinds than there are handles, read in turn by several threads."""
    truth = twelve_bits()
    frames = [lb.open_frames(path) for path in kinds.values()]
    jobs = [(each, k) for k in (8, 0, 5, 3) for each in frames]

    def right(job):
        each, k = job
        return bool((each.read(k, k + 1)[0] == truth[k]).all())

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(right, jobs))
