"""When a window is cut anew, and what is cut, by a method that says where it wants to be."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import pytest

import losbench as lb
from losbench.imaging.engine import Engine
from losbench.imaging.protocols import Estimate
from losbench.imaging.results import SpotFlag

SHAPE = (60, 80)
FRAME = np.random.default_rng(3).normal(100.0, 2.0, (1, *SHAPE))


@dataclass(frozen=True)
class Wanting:
    """Finds its spot at one place of the frame, or so far from wherever it stands."""

    place: tuple[float, float] | None = None
    step: tuple[float, float] = (0.0, 0.0)
    converged: bool = True
    asked: list = field(default_factory=list)
    window: None = None
    width: None = None
    centre: None = None
    hot_pixel_gate: bool = False
    smooth: None = None
    stays: bool = False
    template: ClassVar[bool] = False

    def measure(self, windows):
        count = len(windows.signal)
        self.asked.append((windows.middle[0].tolist(), windows.start[0].tolist()))
        at = self.step if self.place is None else np.array(self.place) - windows.middle
        return Estimate(
            np.broadcast_to(np.array(at, float), (count, 2)).copy(),
            np.ones((count, 2)),
            np.full(count, 1e6),
            np.ones(count),
            np.full(count, 3),
            np.full(count, self.converged),
            np.zeros((count, 2)),
            np.zeros(count, bool),
            np.zeros(count, bool),
        )


def measured(method, start=(40.0, 30.0), *, window=9, background=None, frame=FRAME):
    background = lb.Ring() if background is None else background
    engine = Engine.of_stack(frame, method, background, window)
    middle = np.rint([start]).astype(int)
    width = np.full((1, 2), np.nan)
    found = engine.measure(frame, np.array([0]), middle, np.array([start]), width=width)
    return found, SpotFlag(int(found.flags[0]))


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize(("away", "cuts"), [(0.0, 1), (0.59, 1), (0.61, 2), (3.2, 2)])
def test_a_window_is_cut_anew_six_tenths_of_a_pixel_off_its_middle(axis, sign, away, cuts):
    place = np.array([40.0, 30.0])
    place[axis] += sign * away
    method = Wanting(tuple(place))
    found, flags = measured(method)
    np.testing.assert_allclose(found.xy, [place])
    assert len(method.asked) == cuts and found.n_iter.tolist() == [3 * cuts]
    assert SpotFlag.NOT_CONVERGED not in flags
    if cuts == 2:
        middle, start = method.asked[1]
        assert middle == np.rint(place).tolist()
        np.testing.assert_allclose(start, place - np.rint(place), atol=1e-12)


def test_a_window_is_cut_anew_ten_times():
    method = Wanting(step=(1.0, 0.0))
    found, _ = measured(method, window=31)
    assert [middle for middle, _ in method.asked] == [[40 + k, 30] for k in range(11)]
    assert found.n_iter.tolist() == [33] and found.xy.tolist() == [[51.0, 30.0]]


@pytest.mark.parametrize("converged", [True, False])
def test_under_a_known_level_only_what_has_not_converged_is_cut_anew(converged):
    method = Wanting((42.0, 30.0), converged=converged)
    measured(method, background=lb.Level(100.0))
    assert len(method.asked) == (1 if converged else 2)
    ring = Wanting((42.0, 30.0), converged=converged)
    measured(ring)
    assert len(ring.asked) == 2


def test_a_window_that_stays_is_cut_once():
    method = Wanting((43.0, 30.0), stays=True)
    found, _ = measured(method)
    assert len(method.asked) == 1 and found.xy.tolist() == [[43.0, 30.0]]


@pytest.mark.parametrize(
    ("start", "x", "strayed"),
    [
        *((40.0, 44.4, False), (40.0, 44.6, True), (40.0, 35.6, False), (40.0, 35.4, True)),
        *((40.45, 44.6, True), (40.55, 44.6, False), (40.4, 45.4, True)),
    ],
)
def test_a_window_strays_more_than_half_its_side_from_its_start_and_no_further(start, x, strayed):
    """Nine pixels, by the pixel where it wants to be."""
    for turned in (False, True):
        place, begin = (x, 30.0), (start, 30.0)
        if turned:
            place, begin = (30.0, x), (30.0, start)
        method = Wanting(place)
        _, flags = measured(method, begin)
        assert (SpotFlag.NOT_CONVERGED in flags) == strayed
        assert len(method.asked) == (1 if strayed else 2)


@pytest.mark.parametrize(
    ("start", "place", "cuts"),
    [
        ((3.0, 30.0), (0.3, 30.0), 2),
        ((3.0, 30.0), (-0.6, 30.0), 1),
        ((76.0, 30.0), (79.4, 30.0), 2),
        ((76.0, 30.0), (79.6, 30.0), 1),
        ((40.0, 3.0), (40.0, -0.4), 2),
        ((40.0, 3.0), (40.0, -0.6), 1),
        ((40.0, 56.0), (40.0, 59.4), 2),
        ((40.0, 56.0), (40.0, 59.6), 1),
    ],
)
def test_a_window_is_cut_anew_within_the_frame_alone(start, place, cuts):
    method = Wanting(place)
    measured(method, start, window=9)
    assert len(method.asked) == cuts


def test_what_has_no_centroid_is_not_cut_anew():
    method = Wanting((np.nan, np.nan))
    found, flags = measured(method)
    assert len(method.asked) == 1 and np.isnan(found.xy).all()
    assert SpotFlag.NOT_CONVERGED not in flags


def test_a_window_is_measured_as_far_as_a_pixel_off_its_middle(monkeypatch):
    """Nothing is known of it but what was cut."""
    seen = []
    standing = Wanting.measure

    def measure(self, windows):
        seen.append(windows)
        return standing(self, windows)

    monkeypatch.setattr(Wanting, "measure", measure)
    measured(Wanting((40.0, 30.0)))
    (windows,) = seen
    assert windows.leave == 1.0 and windows.healed is None and windows.kept is None
    assert windows.side == 9 and windows.signal.shape == (1, 11, 11)


# What is cut


@pytest.mark.parametrize("gate", [False, True])
@pytest.mark.parametrize("ring", [None, 17])
def test_a_window_has_a_margin_of_one_pixel_and_no_background(gate, ring):
    method = Wanting(hot_pixel_gate=gate)
    engine = Engine.of_stack(FRAME, method, lb.Ring(ring), 9)
    cut = engine.cut(FRAME, np.array([0]), np.array([[40, 30]]))
    inner = FRAME[:, 25:36, 35:46]
    np.testing.assert_allclose(cut.raw, inner)
    offset = np.arange(-5, 6)
    slope = cut.plane.slope[0]
    plane = cut.plane.level[0] + slope[0] * offset + slope[1] * offset[:, None]
    np.testing.assert_allclose(cut.signal, inner - plane, atol=1e-9)
    assert cut.missing is None and cut.kept is None
    assert (cut.window, cut.ring) == (9, 9 if ring is None else ring)
    assert cut.peak[0] == inner.max() and cut.plane.level[0] == pytest.approx(100.0, abs=1.0)


@pytest.mark.parametrize("gate", [False, True])
@pytest.mark.parametrize("place", [(25, 35), (30, 41), (35, 45)])
def test_pixels_that_were_not_read_are_known_and_hold_no_light(gate, place):
    frame = FRAME.copy()
    frame[0][place] = np.nan
    engine = Engine.of_stack(frame, Wanting(hot_pixel_gate=gate), lb.Ring(), 9)
    cut = engine.cut(frame, np.array([0]), np.array([[40, 30]]))
    assert np.argwhere(cut.missing[0]).tolist() == [[place[0] - 25, place[1] - 35]]
    assert np.isfinite(cut.signal).all() and cut.kept is None
    frame[0, 20:24] = np.nan  # of the ring alone
    frame[0][place] = 100.0
    assert engine.cut(frame, np.array([0]), np.array([[40, 30]])).missing is None


def test_a_template_goes_without_what_was_not_read_or_is_saturated():
    frame = FRAME.copy()
    engine = Engine.of_stack(frame, lb.Weighted(2.0), lb.Ring(), 9, full_scale_dn=5000.0)

    def kept():
        return engine.cut(frame, np.array([0]), np.array([[40, 30]])).kept

    assert kept() is None
    frame[0, 29, 41] = np.nan
    assert np.argwhere(kept()[0] == 0).tolist() == [[4, 6]]
    frame[0, 30, 40], frame[0, 31, 40], frame[0, 32, 40] = 4999.0, 5000.0, 6000.0
    assert np.argwhere(kept()[0] == 0).tolist() == [[4, 6], [6, 5], [7, 5]]
    frame[0, 29, 41] = 100.0
    assert np.argwhere(kept()[0] == 0).tolist() == [[6, 5], [7, 5]]
    frame[0, 31:33, 40] = 4000.0
    assert kept() is None


def test_frames_without_noise_are_known_to_the_last_digit_of_their_highest_reading():
    frame = np.full((1, *SHAPE), 100.5, np.float32)
    for top in (900.5, -900.5):
        frame[:] = 100.5 if top > 0 else -2000.25
        frame[0, 30, 40] = top
        engine = Engine.of_stack(frame, Wanting(), lb.Ring(), 9)
        cut = engine.cut(frame, np.array([0]), np.array([[40, 30]]))
        assert cut.noise.floor[0] == pytest.approx((2.0**-23 * 900.5) ** 2)


def test_full_scale_is_given_or_that_of_the_detector_or_of_the_readings():
    def of(dtype, **options):
        given = np.zeros((1, 20, 20), dtype), Wanting(), lb.Ring(), 5
        return Engine.of_stack(*given, **options).full_scale_dn

    detector = lb.Detector(gain_e_per_dn=2.0, read_noise_e=5.0, offset_dn=100.0, bits=12)
    assert of(np.uint16) == 65535.0 and of(np.int16) == 32767.0 and of(float) == np.inf
    assert of(np.uint16, noise=detector) == np.floor(detector.full_scale_dn)
    assert of(np.uint16, noise=detector, full_scale_dn=900.5) == 900.5


@pytest.mark.parametrize(("shape", "fits"), [((9, 20), True), ((20, 9), True), ((8, 20), False)])
def test_a_window_fits_into_its_frames_and_into_its_ring(shape, fits):
    given = Wanting(), lb.Ring()
    if fits:
        assert Engine.of_stack(np.zeros((1, *shape)), *given, 9).ring == 9
    else:
        with pytest.raises(ValueError, match="window of 9 x 9 pixels does not fit into frames of"):
            Engine.of_stack(np.zeros((1, *shape)), *given, 9)
    with pytest.raises(ValueError, match="ring"):
        Engine.of_stack(FRAME, Wanting(), lb.Ring(7), 9)
