"""The noise of one frame, from what a Gaussian leaves of its spots; no noise from other shapes.

Seeds were fixed before the first run.
"""

import numpy as np
import pytest

import losbench as lb
from losbench.imaging.results import SpotFlag

CAMERA = lb.Detector(gain_e_per_dn=2.0, read_noise_e=5.0, offset_dn=100.0)


def frame_of(count, flux, seed, shape=None, sigma=2.0):
    """One frame of spots 40 px apart, round ones unless a profile of the distance is given."""
    rng = np.random.default_rng([seed, count])
    across = int(np.ceil(np.sqrt(count)))
    cells = np.stack(np.meshgrid(*[np.arange(across)] * 2), axis=-1).reshape(-1, 2)[:count]
    xy = cells * 40.0 + 30.0 + rng.uniform(-0.5, 0.5, (count, 2))
    size = (40 * across + 20,) * 2
    if shape is None:
        light = lb.render_spots(xy, flux, sigma, size)
    else:
        row, column = np.indices(size)
        profiles = [shape(np.hypot(column - x, row - y)) for x, y in xy]
        light = sum(flux * profile / profile.sum() for profile in profiles)
    return CAMERA.expose(light + 30.0, rng), xy


def moffat(away):
    return (1.0 + (away / 3.0) ** 2) ** -2.5


def steeper_moffat(away):
    return (1.0 + (away / 5.5) ** 2) ** -6.0


def disc(away):
    return np.clip(4.5 - away, 0.0, 1.0)


@pytest.mark.parametrize("method", ["eiwa", "weighted"])
@pytest.mark.parametrize(("count", "runs"), [(1, 150), (4, 40), (100, 3)])
@pytest.mark.parametrize("flux", [2e4, 2e5])
def test_errors_of_one_frame_of_round_spots_are_those_that_are_made(count, runs, flux, method):
    stated, made = [], []
    for seed in range(runs):
        frame, xy = frame_of(count, flux, 500 + seed)
        found = lb.centroid(frame, np.rint(xy), method=method)
        known = found.flags & SpotFlag.LOWER_BOUND == 0
        if not known.all():
            assert count == 1 and not known.any()
            continue
        assert found.noise.per_dn == pytest.approx(0.5, abs=5.0 * found.noise.std_error)
        stated.append(np.mean(found.sigma_xy**2))
        made.append(np.mean((found.xy - xy) ** 2))
    assert len(made) > 0.9 * runs
    # 300 and more errors: their root mean square is known to four percent.
    assert 0.87 < np.sqrt(np.mean(stated) / np.mean(made)) < 1.13


def test_the_gain_of_one_frame_scatters_by_its_error():
    found = [lb.centroid(*_started(frame_of(4, 5e4, 900 + seed))).noise for seed in range(60)]
    off = [(gain.per_dn - 0.5) / gain.std_error for gain in found if gain.known]
    assert len(off) > 55
    assert abs(np.mean(off)) < 0.5 and np.std(off) == pytest.approx(1.0, abs=0.3)


@pytest.mark.parametrize("shape", [moffat, steeper_moffat, disc])
@pytest.mark.parametrize("count", [1, 9])
def test_spots_of_another_shape_give_lower_bounds_that_are_flagged(shape, count):
    for seed in range(4):
        frame, xy = frame_of(count, 2e5, 700 + seed, shape)
        found = lb.centroid(frame, np.rint(xy))
        assert not found.noise.known and (found.flags & SpotFlag.LOWER_BOUND > 0).all()


def test_spots_too_faint_to_tell_give_lower_bounds_that_are_flagged():
    frame, xy = frame_of(1, 1e3, 800)
    found = lb.centroid(frame, np.rint(xy))
    assert not found.noise.known and found.flags[0] & SpotFlag.LOWER_BOUND
    nothing = lb.centroid(np.full((40, 40), 7.0), [[20, 20]])
    assert not nothing.noise.known


def _started(made):
    frame, xy = made
    return frame, np.rint(xy)
