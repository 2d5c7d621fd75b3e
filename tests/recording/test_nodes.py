"""Spots followed through a few frames: together where they keep to their places, else one by one,
and the path is the same.
"""

import cv2
import numpy as np
import pytest

import losbench as lb
from losbench.recording import nodes
from losbench.recording.stamps import Stamp

SHAPE, N = (300, 110), 50
SPOTS = np.array([[30.0, 60.0], [80.0, 220.0]])
SENSOR = lb.Detector(gain_e_per_dn=2.0, read_noise_e=5.0, offset_dn=100.0)


def still():
    return np.zeros((N, 2, 2)), np.ones((N, 2))


def drift():
    """Over three windows, more within sixteen nodes than one reaches."""
    return np.arange(N)[:, None, None] * np.array([0.3, 0.8]) + np.zeros((1, 2, 1)), np.ones((N, 2))


def fast():
    """Two pixels a node: of a few nodes only the first is within reach."""
    return np.minimum(np.arange(N), 30)[:, None, None] * np.array([0.4, 2.0]) + np.zeros(
        (1, 2, 1)
    ), np.ones((N, 2))


def jump():
    """Beyond reach, both alike."""
    off, light = still()
    off[21:] += [12.0, 40.0]
    return off, light


def lost():
    """One for ten nodes, the other for the last."""
    off, light = still()
    light[13:23, 1] = light[-1, 0] = 0.0
    return off, light


def wandering():
    rng = np.random.default_rng(3)
    return np.cumsum(rng.normal(0.0, 0.7, (N, 2, 2)), axis=0), np.ones((N, 2))


WAYS = [still, drift, fast, jump, lost, wandering]


def recorded(way, **options):
    off, light = way()
    electrons = [
        lb.render_spots(SPOTS + by, 1e5 * f, 2.0, SHAPE) + 40.0
        for by, f in zip(off, light, strict=True)
    ]
    return lb.read_recording(SENSOR.expose(np.stack(electrons), 3), detector=SENSOR, **options)


def through(recording, method=None, background=None):
    chosen = method or lb.EIWA(13, centre="peak")
    frames = np.arange(recording.n_frames)
    under = background or lb.Ring()
    return nodes.through(recording, recording.stamps[0], frames, SPOTS, chosen, under)


def one_by_one(monkeypatch, *job):
    with monkeypatch.context() as patch:
        patch.setattr(nodes, "_TOGETHER", 1)
        return through(*job)


def the_same(found, expected):
    for name in ("path", "flux"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-8)
    assert found.method == expected.method
    assert list(found.close) == list(expected.close)
    for node, squares in found.close.items():
        np.testing.assert_array_equal(squares, expected.close[node])


@pytest.mark.parametrize("way", WAYS, ids=lambda way: way.__name__)
def test_the_path_is_that_of_one_node_after_the_other(way, monkeypatch):
    recording = recorded(way)
    found = through(recording)
    the_same(found, one_by_one(monkeypatch, recording))
    off, light = way()
    seen = np.isfinite(found.path[..., 0])
    np.testing.assert_array_equal(seen, light > 0)
    assert np.abs(found.path - SPOTS - off)[seen].max() < 0.1
    assert found.close.keys() == set(range(N))


@pytest.mark.parametrize(
    ("method", "background"),
    [
        (lb.AutoCentroid(window=13, centre="peak"), lb.Ring(25)),
        (lb.Weighted(centre="peak"), None),
        (lb.EIWA((7, 23), centre="peak"), None),
        (lb.EIWA(13, centre="peak", hot_pixel_gate=True), None),
    ],
    ids=str,
)
def test_whatever_is_chosen(method, background, monkeypatch):
    recording = recorded(wandering)
    the_same(
        through(recording, method, background),
        one_by_one(monkeypatch, recording, method, background),
    )


def test_pixels_that_are_bad_and_nodes_that_cannot_be_read(tmp_path, monkeypatch):
    bad = np.zeros(SHAPE, bool)
    bad[58, 31] = bad[150] = True
    stack = recorded(wandering).stamps[0].read(0, N, skip=False).frames
    for k, frame in enumerate(stack):
        cv2.imwrite(str(tmp_path / f"{k:02d}.png"), frame)
    gaps = [0, 1, 9, 20, 21, N - 1]
    recording = lb.read_recording(
        tmp_path, detector=SENSOR, bad_pixels=bad, on_unreadable="skip", period_s=1.0
    )
    for k in gaps:
        (tmp_path / f"{k:02d}.png").write_bytes(b"no image")
    found = through(recording)
    the_same(found, one_by_one(monkeypatch, recording))
    missing = np.isnan(found.path).all(axis=(1, 2))
    assert np.flatnonzero(missing).tolist() == gaps
    assert found.close.keys() == set(range(N)) - set(gaps)
    for k in range(N):
        (tmp_path / f"{k:02d}.png").write_bytes(b"no image")
    nothing = through(recording)
    assert np.isnan(nothing.path).all() and np.isnan(nothing.flux).all() and not nothing.close
    assert nothing.method.window == 13 and not nothing.strangers.size


def test_noise_without_a_detector_is_of_one_step_for_all(monkeypatch):
    stack = recorded(drift).stamps[0].read(0, N, skip=False).frames
    recording = lb.read_recording(16 * stack.astype(np.uint16))
    the_same(through(recording), one_by_one(monkeypatch, recording))


def looks(monkeypatch, recording):
    """How many rows each read was of, 0 for a whole frame."""
    counts, real = [], Stamp.read

    def read(self, first, last, *, skip, spans=None):
        counts.append(0 if spans is None else sum(end - begin for begin, end in spans))
        return real(self, first, last, skip=skip, spans=spans)

    with monkeypatch.context() as patch:
        patch.setattr(Stamp, "read", read)
        through(recording)
    return counts


def test_of_spots_that_stay_two_frames_are_read_whole_and_few_rows_of_the_others(monkeypatch):
    rows = looks(monkeypatch, recorded(still))
    assert rows[:2] == [0, 0]  # to settle the window, and to begin
    assert len(rows) == 1 + N and 0 < min(rows[2:]) <= max(rows) < 0.5 * SHAPE[0]


@pytest.mark.parametrize(("by", "alone"), [(2.4, 1), (2.6, 2)])
def test_near_is_half_a_pixel_less_than_a_quarter_of_the_window(by, alone, monkeypatch):
    """Of 13 that is 2.5 pixels."""

    def moved():
        off, light = still()
        off[30:, 0, 0] = by
        return off, light

    called, real = [], nodes._Walk.alone
    monkeypatch.setattr(
        nodes._Walk, "alone", lambda self, node, last: called.append(node) or real(self, node, last)
    )
    through(recorded(moved))
    assert called == [0, 30][:alone]


def test_sixteen_nodes_at_most_are_together_and_as_many_as_fit(monkeypatch):
    seen, real = [], nodes.centroid
    recording = recorded(still)

    def centroid(frames, *job, **options):
        seen.append(len(frames))
        return real(frames, *job, **options)

    monkeypatch.setattr(nodes, "centroid", centroid)
    whole = through(recording)
    assert seen == [1, 2, 4, 8, 16, 16, 3]
    seen.clear()
    read = looks(monkeypatch, recording)[-1]
    seen.clear()
    monkeypatch.setattr(nodes, "_BYTES", 5 * read * SHAPE[1] * 2)
    few = through(recording)
    assert seen == [1, 2, 4, *[5] * 8, 3]
    the_same(few, whole)
    seen.clear()
    monkeypatch.setattr(nodes, "_BYTES", 1)
    the_same(through(recording), whole)
    assert seen == [1] * N
