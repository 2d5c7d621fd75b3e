"""What is judged of a window at rest, flag by flag and from either side of each number."""

from dataclasses import replace

import numpy as np
import pytest

from losbench.imaging.background import Plane
from losbench.imaging.flags import Cut, judged
from losbench.imaging.noise import PixelNoise
from losbench.imaging.protocols import Estimate
from losbench.imaging.results import SpotFlag

SIDE, RING_SIDE, SHAPE = 9, 9, (60, 80)
MIDDLE = (40, 30)


def plane_of(count, **fields):
    zero = np.zeros(count)
    values = {
        "level": zero + 100.0,
        "slope": np.zeros((count, 2)),
        "scatter": zero + 3.0,
        "level_variance": zero,
        "slope_variance": np.zeros((count, 2)),
        "excess": zero,
        "excess_error": zero + 1.0,
        "outlier": zero,
        "noise": zero + 3.0,
        "clipped": np.zeros(count, bool),
    }
    return Plane(**values | fields)


def cut_of(count=1, *, missing=None, kept=None, ring=RING_SIDE, saturated=False, **plane):
    pixels = np.zeros((count, SIDE + 2, SIDE + 2))
    noise = PixelNoise(np.full(count, 9.0), 0.0, np.zeros((count, 3)))
    return Cut(
        pixels,
        pixels,
        missing,
        kept,
        np.full(count, 1100.0),
        np.full(count, saturated),
        plane_of(count, **plane),
        noise,
        SIDE,
        ring,
    )


def estimate_of(count=1, **fields):
    values = {
        "centroid": np.zeros((count, 2)),
        "sigma": np.full((count, 2), 0.1),
        "flux": np.full(count, 1e4),
        "sigma_flux": np.full(count, 100.0),
        "n_iter": np.full(count, 3),
        "converged": np.ones(count, bool),
        "middle": np.zeros((count, 2)),
        "slow": np.zeros(count, bool),
        "misfit": np.zeros(count, bool),
    }
    return Estimate(**values | fields)


def judge(middle=MIDDLE, cut=None, **fields):
    """Flags and the rest of one window."""
    cut = cut_of() if cut is None else cut
    found = judged(SHAPE, np.array([middle]), cut, estimate_of(**fields))
    return SpotFlag(int(found.flags[0])), found


def test_a_window_without_reproach_has_no_flag_and_the_place_in_its_frame():
    flags, found = judge(centroid=np.array([[0.3, -0.2]]), middle=(33, 21))
    assert flags == SpotFlag(0) and found.n_bad.tolist() == [0] and found.n_iter.tolist() == [3]
    np.testing.assert_allclose(found.xy, [[33.3, 20.8]])
    assert found.sigma_xy.tolist() == [[0.1, 0.1]] and found.background.tolist() == [100.0]


@pytest.mark.parametrize(("axis", "last"), [(0, SHAPE[1] - 1), (1, SHAPE[0] - 1)])
@pytest.mark.parametrize("far", [False, True])
def test_a_window_leaves_the_frame_where_it_passes_the_border_of_a_pixel(axis, last, far):
    """Nine pixels about the fourth begin where the frame does. The ring reaches beyond anyhow."""
    at, outwards = np.array([MIDDLE]), 1.0 if far else -1.0
    at[0, axis] = last - 4 if far else 4
    for beyond, leaves in ((-0.3, False), (0.0, False), (1e-10, False), (1e-6, True), (0.3, True)):
        middle = np.zeros((1, 2))
        middle[0, axis] = beyond * outwards
        found = judged(SHAPE, at, cut_of(), estimate_of(middle=middle))
        assert found.flags.tolist() == [SpotFlag.EDGE]
        assert np.isnan(found.xy).all() == np.isnan(found.sigma_xy).all() == leaves


@pytest.mark.parametrize(("axis", "last"), [(0, SHAPE[1] - 1), (1, SHAPE[0] - 1)])
@pytest.mark.parametrize("ring", [9, 15])
def test_a_ring_of_four_pixels_is_within_the_frame_or_flagged(axis, last, ring):
    reach = ring // 2 + 4
    for near in (reach, last - reach):
        at = list(MIDDLE)
        at[axis] = near
        assert judge(at, cut_of(ring=ring))[0] == SpotFlag(0)
        at[axis] += -1 if near == reach else 1
        flags, found = judge(at, cut_of(ring=ring))
        assert flags == SpotFlag.EDGE and np.isfinite(found.xy).all()


@pytest.mark.parametrize(
    ("flux", "faint"), [(499.0, True), (501.0, False), (0.0, True), (-1e4, True), (np.nan, True)]
)
def test_a_flux_below_five_of_its_errors_is_too_faint(flux, faint):
    flags, found = judge(flux=np.array([flux]))
    assert flags == (SpotFlag.TOO_FAINT if faint else SpotFlag(0))
    assert np.isnan(found.xy).all() == faint
    assert judge(flux=np.zeros(1), sigma_flux=np.zeros(1))[0] == SpotFlag.TOO_FAINT


@pytest.mark.parametrize(("excess", "error", "leaks"), [(11.0, 2.0, True), (9.9, 2.0, False)])
def test_a_ring_grows_brighter_by_five_errors(excess, error, leaks):
    cut = cut_of(excess=np.array([excess]), excess_error=np.array([error]), level=np.array([900.0]))
    flags, found = judge(cut=cut)
    assert flags == (SpotFlag.RING if leaks else SpotFlag(0)) and np.isfinite(found.xy).all()


@pytest.mark.parametrize(("excess", "leaks"), [(9.9, False), (10.1, True)])
def test_a_ring_grows_brighter_by_a_hundredth_of_the_height_of_the_peak(excess, leaks):
    """1100 DN, of which 100 are the level at the centroid, or 200 on a slope."""
    cut = cut_of(excess=np.array([excess]), level=np.array([100.0]))
    assert judge(cut=cut)[0] == (SpotFlag.RING if leaks else SpotFlag(0))
    slope = np.array([[50.0, 0.0]])
    cut = cut_of(excess=np.array([excess - 1.0]), level=np.array([100.0]), slope=slope)
    flags, found = judge(cut=cut, centroid=np.array([[2.0, 0.0]]))
    assert found.background.tolist() == [200.0]
    assert flags == (SpotFlag.RING if leaks else SpotFlag(0))


def test_what_leaks_or_does_not_fit_is_told_of_spots_that_are_measured():
    leaking = cut_of(excess=np.array([100.0]))
    faint, misfit = {"flux": np.zeros(1)}, {"misfit": np.ones(1, bool)}
    assert judge(cut=leaking, **misfit)[0] == SpotFlag.RING | SpotFlag.MISFIT
    assert judge(cut=leaking, **misfit, **faint)[0] == SpotFlag.TOO_FAINT
    assert judge((2, 30), leaking, **misfit)[0] == SpotFlag.EDGE  # the window leaves
    assert judge((6, 30), leaking, **misfit)[0] == SpotFlag.EDGE | SpotFlag.MISFIT  # the ring does


@pytest.mark.parametrize("field", ["slow", "converged"])
def test_what_the_method_tells_is_handed_on(field):
    wrong = {"slow": SpotFlag.SLOW, "converged": SpotFlag.NOT_CONVERGED}[field]
    flags, found = judge(**{field: np.array([field == "slow"])})
    assert flags == wrong and np.isfinite(found.xy).all()


def test_saturation_and_clipped_black_are_handed_on():
    assert judge(cut=cut_of(saturated=True))[0] == SpotFlag.SATURATED
    assert judge(cut=cut_of(clipped=np.ones(1, bool)))[0] == SpotFlag.CLIPPED


# Pixels that were not read


def missing_of(n, first=(1, 1)):
    """Mask of that many pixels of a window, in its order, within a margin of one."""
    inner = np.zeros(SIDE**2, bool)
    start = (first[0] - 1) * SIDE + first[1] - 1
    inner[start : start + n] = True
    return np.pad(inner.reshape(SIDE, SIDE), 1)[None]


def test_a_pixel_of_a_window_that_was_not_read_leaves_no_centroid():
    flags, found = judge(cut=cut_of(missing=missing_of(1)), converged=np.zeros(1, bool))
    assert flags == SpotFlag.MISSING and np.isnan(found.xy).all() and found.n_bad.tolist() == [0]
    assert judge(cut=cut_of(missing=missing_of(0)))[0] == SpotFlag(0)
    margin = np.zeros_like(missing_of(0))
    margin[0, 0] = True
    assert judge(cut=cut_of(missing=margin))[0] == SpotFlag(0)
    up = estimate_of(middle=np.array([[0.0, -0.25]]))  # a quarter of the margin is in the window
    found = judged(SHAPE, np.array([MIDDLE]), cut_of(missing=margin), up)
    assert found.flags.tolist() == [SpotFlag.MISSING]
    assert judge(cut=cut_of(missing=missing_of(1)), flux=np.zeros(1))[0] == SpotFlag.MISSING


@pytest.mark.parametrize(("n", "borne"), [(1, True), (12, True), (13, False)])
def test_a_template_goes_without_fifteen_of_a_hundred_pixels(n, borne):
    """Of 81."""
    kept = np.ones((1, SIDE + 2, SIDE + 2))
    flags, found = judge(cut=cut_of(missing=missing_of(n), kept=kept))
    assert flags == (SpotFlag.BAD_PIXEL if borne else SpotFlag.MISSING)
    assert found.n_bad.tolist() == [n if borne else 0]
    assert np.isfinite(found.xy).all() == borne
    gone, found = judge((2, 30), cut_of(missing=missing_of(n), kept=kept))
    assert gone == SpotFlag.EDGE and found.n_bad.tolist() == [0]


def test_each_window_is_judged_by_itself():
    missing = np.concatenate([missing_of(0), missing_of(1), missing_of(0)])
    at = np.array([MIDDLE, MIDDLE, (2, 30)])
    fit = estimate_of(3, flux=np.array([1e4, 1e4, 0.0]))
    found = judged(SHAPE, at, cut_of(3, missing=missing), fit)
    assert found.flags.tolist() == [0, SpotFlag.MISSING, SpotFlag.EDGE | SpotFlag.TOO_FAINT]
    some = cut_of(3, missing=missing, kept=1.0 * missing, level=np.arange(3.0)).of(np.array([2, 1]))
    assert some.plane.level.tolist() == [2.0, 1.0] and some.kept.any(axis=(1, 2)).tolist() == [
        False,
        True,
    ]
    none = replace(some, missing=None, kept=None).of(np.array([0]))
    assert none.missing is None and none.kept is None and len(none.raw) == 1
