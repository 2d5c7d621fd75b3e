"""Who is looked at a second time, and what becomes of them, number by number; what others tell is made
up."""

from dataclasses import replace

import numpy as np
import pytest

import losbench as lb
from losbench.imaging import cleaning
from losbench.imaging.cleaning import Scene, _asking, _crowded, look_again
from losbench.imaging.engine import Engine
from losbench.imaging.flags import judged
from losbench.imaging.protocols import Windows
from losbench.imaging.results import SpotFlag
from losbench.imaging.scrutiny import Looked
from losbench.imaging.template import TemplateFit

SIDE, HEIGHT, LEVEL = 13, 1000.0, 100.0


class Bench:
    """Spots in one frame, each in its window, as the engine hands them on."""

    def __init__(self, count=1, method=None, at=(0.0, 0.0), ring=None):
        method = lb.EIWA() if method is None else method
        x = 30 + 40 * np.arange(count)
        self.middle = np.stack([x, np.full(count, 30)], axis=-1)
        places = self.middle + np.array(at)
        light = lb.render_spots(places, 1.0, 2.0, (61, 40 * count + 21))
        noise = np.random.default_rng(5).normal(LEVEL, 1.0, light.shape)
        self.stack = (HEIGHT * light / light.max() + noise)[None]
        frame = np.zeros(count, int)
        engine = Engine.of_stack(self.stack, method, lb.Ring(ring), SIDE)
        self.cut = engine.cut(self.stack, frame, self.middle)
        width = np.full((count, 2), 2.0 if method.template else np.nan)
        start = np.tile(np.array(at, float), (count, 1))
        self.windows = Windows(
            self.cut.signal, SIDE, start, self.middle, self.cut.noise, width, self.cut.kept
        )
        self.fit = method.measure(self.windows)
        self.result = judged(self.stack.shape[1:], self.middle, self.cut, self.fit)
        self.scene = Scene(self.stack, frame, method, engine.ring, engine.background.tilts)

    def looked(self, *, fits=True):
        """Windows that are clean, with the template that made them."""
        count = len(self.middle)
        shape = (count, SIDE + 2, SIDE + 2)
        fit = TemplateFit(
            self.fit.centroid.copy(),
            np.full((count, 2), 2.0),
            self.fit.flux.copy(),
            np.ones((count, 3)),
            np.ones(count, int),
            np.ones(count, bool),
        )
        none = np.zeros(count, int)
        return Looked(np.ones(shape), np.zeros(shape, bool), none, fit, np.full(count, fits))


@pytest.fixture
def spied(monkeypatch):
    """What one function of the room was asked; it answers as it is told to."""

    def spy(name, answer):
        asked = []

        def told(*given, **options):
            asked.append((given, options))
            if callable(answer):
                return answer(*given)
            return np.full(len(getattr(given[0], "signal", given[0])), answer)

        monkeypatch.setattr(cleaning, name, told)
        return asked

    return spy


# Who asks


def asking(bench, *, outlier, scatter, settled=True, lean=True, peak=LEVEL + HEIGHT):
    plane = replace(
        bench.cut.plane,
        level=np.array([LEVEL]),
        outlier=np.array([outlier]),
        scatter=np.array([scatter]),
    )
    cut = replace(bench.cut, plane=plane, peak=np.array([peak]))
    given = np.array([settled]), np.array([lean])
    return bool(len(_asking(bench.scene, cut, bench.windows, bench.fit, *given)))


@pytest.mark.parametrize(("outlier", "asks"), [(4.9, False), (5.1, True)])
def test_a_ring_asks_where_a_pixel_stands_out_by_five_scatters(spied, outlier, asks):
    spied("asks", False), spied("one_sided", True)
    assert asking(Bench(), outlier=outlier, scatter=3.0) == asks


@pytest.mark.parametrize(("height", "asks"), [(9.9, False), (10.1, True)])
def test_a_ring_asks_where_a_pixel_stands_out_by_a_hundredth_of_the_peak(spied, height, asks):
    """Above the level: 1000 DN."""
    spied("asks", False), spied("one_sided", True)
    assert asking(Bench(), outlier=height / 0.1, scatter=0.1) == asks


def test_only_windows_at_rest_with_a_ring_free_of_their_light_are_asked(spied):
    spied("asks", False)
    beside = spied("one_sided", True)
    assert asking(Bench(), outlier=9.0, scatter=3.0)
    assert not asking(Bench(), outlier=9.0, scatter=3.0, settled=False)
    assert not asking(Bench(), outlier=9.0, scatter=3.0, lean=False)
    assert len(beside) == 1
    spied("asks", True)
    assert asking(Bench(), outlier=9.0, scatter=3.0) and len(beside) == 1, "asked for already"
    assert asking(Bench(), outlier=0.0, scatter=3.0, lean=False)
    assert not asking(Bench(), outlier=9.0, scatter=3.0, settled=False)
    spied("asks", False), spied("one_sided", False)
    assert not asking(Bench(), outlier=9.0, scatter=3.0)


def test_the_first_look_is_at_eight_tenths_of_what_makes_a_neighbour(spied):
    """Of 5.5 errors and of 2 % of the peak; pixels that were not read count for nothing."""
    bench = Bench(3, at=(0.25, -0.25))
    bench.stack[0, 20, 30] = np.nan
    spied("asks", lambda *_: np.array([True, False, False]))
    beside = spied("one_sided", lambda *_: np.array([False, True]))
    plane = replace(bench.cut.plane, outlier=np.full(3, 9.0), scatter=np.full(3, 30.0))
    every = np.ones(3, bool)
    given = replace(bench.cut, plane=plane), bench.windows, bench.fit, every, every
    assert _asking(bench.scene, *given).tolist() == [0, 2]
    (((stamps, kept, noise, centre, side), options),) = beside
    assert options == {"sure": 0.8, "of_peak": pytest.approx(0.016)} and side == SIDE
    assert stamps.shape == kept.shape == (2, SIDE + 8, SIDE + 8) and (kept == 1).all()
    np.testing.assert_array_equal(centre, bench.fit.centroid[1:])
    np.testing.assert_array_equal(noise.floor, bench.cut.noise.floor[1:])
    inner = stamps[:, 3:-3, 3:-3] - bench.cut.signal[1:]
    np.testing.assert_allclose(inner, 0.0, atol=1e-3)
    spied("asks", False)
    beside = spied("one_sided", lambda *_: np.ones(3, bool))
    assert _asking(bench.scene, *given).tolist() == [0, 1, 2]
    (((stamps, kept, *_), _),) = beside
    assert np.argwhere(kept == 0).tolist() == [[0, 0, 10]] and stamps[0, 0, 10] == 0.0


# Light of another spot


def crowded(bench, looked):
    some = np.arange(len(bench.middle))
    return _crowded(bench.scene, bench.cut, bench.windows, looked, some)


def test_pixels_and_lines_that_were_left_out_count_for_nothing_in_window_and_ring(spied):
    bench = Bench(3)
    bench.stack[0, 21, 72] = np.nan
    looked = bench.looked()
    looked.kept[0, 3, 4] = 0.0
    looked.kept[1, 5], looked.lines[1, 5] = 0.0, True
    looked.kept[2, :, 6], looked.lines[2, :, 6] = 0.0, True
    looked.lines[0, 2, 3:9] = True  # which is no line
    asked = spied("lopsided", True)
    assert crowded(bench, looked).tolist() == [True] * 3
    (((stamps, kept, noise, fit), options),) = asked
    assert not options and fit is looked.fit and noise is bench.windows.noise
    expected = np.ones((3, 21, 21))
    expected[0, 6, 7] = expected[1, 1, 12] = 0.0  # a margin and the rest of the ring: three
    expected[1, 8], expected[2, :, 9] = 0.0, 0.0
    np.testing.assert_array_equal(kept, expected)
    assert stamps[1, 1, 12] == 0.0 and np.isfinite(stamps).all()
    np.testing.assert_allclose(stamps[:, 3:-3, 3:-3], bench.cut.signal, atol=1e-3)


def test_where_a_template_tells_nothing_light_is_a_tenth_of_the_peak(spied):
    """About the centroid, and one pixel may hold it all."""
    bench = Bench(3, at=(0.25, -0.25))
    looked = replace(bench.looked(), fits=np.array([True, False, False]))
    looked.kept[1, 3, 4] = 0.0
    spied("lopsided", lambda *_: np.array([True, True, False]))
    beside = spied("one_sided", lambda *_: np.array([False, True]))
    assert crowded(bench, looked).tolist() == [True, False, True]
    (((stamps, kept, noise, centre, side), options),) = beside
    assert options == {"of_peak": 0.1, "lone": None} and side == SIDE
    assert len(stamps) == 2 and np.argwhere(kept == 0).tolist() == [[0, 6, 7]]
    np.testing.assert_array_equal(centre, bench.windows.start[1:])
    np.testing.assert_array_equal(noise.floor, bench.windows.noise.floor[1:])
    spied("lopsided", False)
    assert not crowded(bench, bench.looked()).any() and len(beside) == 1


# The second look


def again(bench, settled=None):
    settled = np.ones(len(bench.middle), bool) if settled is None else np.array(settled)
    look_again(bench.scene, bench.cut, bench.windows, bench.fit, bench.result, settled)
    return [SpotFlag(bits) for bits in bench.result.flags.tolist()]


def test_windows_that_do_not_ask_are_left_alone(spied):
    closely = spied("_look_closely", lambda *_: None)
    bench = Bench(2)
    before = bench.result.xy.copy()
    assert again(bench) == [SpotFlag(0)] * 2 and not closely
    np.testing.assert_array_equal(bench.result.xy, before)


def test_a_spot_without_one_of_its_coordinates_is_not_looked_at(spied):
    for coordinate in (0, 1):
        bench = Bench(2)
        bench.result.xy[0, coordinate] = np.nan
        spied("_asking", lambda *given: np.flatnonzero(given[4]))
        closely = spied("_look_closely", lambda *_: None)
        glance = spied("two_tops", True)
        spied("dark_in_the_middle", True)
        assert again(bench) == [SpotFlag(0), SpotFlag.NEIGHBOUR]
        assert closely[0][0][-1].tolist() == [1] and len(glance[0][0][1]) == 1
        assert again(Bench(2), [False, False]) == [SpotFlag(0)] * 2
        assert len(closely) == len(glance) == 1


def test_a_glance_goes_by_the_height_above_the_level(spied):
    bench = Bench(2)
    spied("_asking", lambda *_: np.zeros(0, int))
    dark = spied("dark_in_the_middle", lambda *_: np.array([False, True]))
    tops = spied("two_tops", True)
    assert again(bench) == [SpotFlag(0), SpotFlag.NEIGHBOUR]
    np.testing.assert_allclose(dark[0][0][2], HEIGHT, rtol=0.01)
    np.testing.assert_array_equal(tops[0][0][1], bench.fit.centroid[1:])
    spied("two_tops", False)
    assert again(Bench(2)) == [SpotFlag(0)] * 2


def test_a_ring_with_light_of_the_spot_is_not_asked(spied):
    bench = Bench(2)
    bench.result.flags[0] = SpotFlag.RING
    asked = spied("_asking", lambda *_: np.zeros(0, int))
    again(bench)
    assert asked[0][0][-1].tolist() == [False, True]


def looking(spied, bench, *, n_bad, sparse=True):
    """A close look that finds so many bad pixels in each window."""
    count = len(n_bad)
    looked = bench.looked()
    for k in range(count):
        places = range(n_bad[k]) if sparse else (0,) * n_bad[k]
        for i, j in enumerate(places):
            looked.kept[k, 3, 2 + (3 * j if sparse else i)] = 0.0
    asked = spied("look_into", lambda *_: replace(looked, n_bad=np.array(n_bad)))
    spied("asks", True)
    return asked


@pytest.mark.parametrize("method", [lb.EIWA(), lb.Weighted()])
def test_bad_pixels_are_counted_and_their_windows_measured_anew(spied, method):
    bench = Bench(3, method, at=(0.25, -0.25))
    bench.result.n_bad[:] = 1, 0, 0
    bench.result.flags[1] = SpotFlag.NOT_CONVERGED | SpotFlag.SLOW
    before, rounds = bench.result.xy.copy(), bench.result.n_iter.copy()
    asked = looking(spied, bench, n_bad=[0, 2, 1])
    spied("lopsided", False)
    bad = SpotFlag.BAD_PIXEL
    assert again(bench) == [SpotFlag(0), bad | SpotFlag.NOT_CONVERGED, bad]
    assert bench.result.n_bad.tolist() == [1, 2, 1]
    part = asked[0][0][0]
    assert part.leave == SIDE / 3.0 and (part.start == bench.fit.centroid).all()
    np.testing.assert_array_equal(bench.result.xy[0], before[0])
    np.testing.assert_allclose(bench.result.xy, before, atol=0.05)
    assert bench.result.n_iter[0] == rounds[0] and (bench.result.n_iter[1:] > rounds[1:]).all()


def test_a_moment_is_measured_anew_where_few_pixels_are_left_out_of_a_ring_s_plane(spied):
    for sparse, tilts in ((True, True), (False, True), (True, False)):
        bench = Bench(1)
        bench.scene = replace(bench.scene, tilts=tilts)
        rounds = int(bench.result.n_iter[0])
        looking(spied, bench, n_bad=[3], sparse=sparse)
        side_by_side = spied("lopsided", False)
        assert again(bench) == [SpotFlag.BAD_PIXEL] and bench.result.n_bad.tolist() == [3]
        assert (bench.result.n_iter[0] > rounds) == (sparse and tilts)
        kept = side_by_side[0][0][1]  # a moment cannot leave out what stands side by side
        assert (kept == 0).sum() == (3 if sparse else 0)


def test_a_template_leaves_out_what_a_moment_cannot(spied):
    bench = Bench(1, lb.Weighted())
    rounds = int(bench.result.n_iter[0])
    looking(spied, bench, n_bad=[3], sparse=False)
    kept = spied("lopsided", True)
    assert again(bench) == [SpotFlag.BAD_PIXEL | SpotFlag.NEIGHBOUR]
    assert bench.result.n_iter[0] > rounds and (kept[0][0][1] == 0).sum() == 3
