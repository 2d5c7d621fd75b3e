"""Small fixed geometries, where robustness is won or lost by design."""

import numpy as np
import pytest

import losbench as lb

ANY_NUMBER = {"max_iter": 300, "on_fail": "ignore"}


def ring(count, trials, seed):
    """Rows (1, 0, -v), (0, 1, u) of spots on a unit circle; unit noise, and one spot off by 100."""
    rng = np.random.default_rng(seed)
    angle = 2 * np.pi * np.arange(count) / count
    u, v, one, zero = np.cos(angle), np.sin(angle), np.ones(count), np.zeros(count)
    design = np.stack(
        [np.stack([one, zero, -v], axis=1), np.stack([zero, one, u], axis=1)], axis=1
    ).reshape(-1, 3)
    y = rng.standard_normal((trials, count, 2))
    heading, bad = rng.uniform(0, 2 * np.pi, trials), rng.integers(0, count, trials)
    y[np.arange(trials), bad] += 100 * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    return design, y.reshape(trials, -1)


def error(fit):
    return float(np.sqrt(np.mean(fit.x[:, 0] ** 2)))


RING = {
    "least squares": (lb.lstsq, {}, (17.7, 8.84)),
    "std": (lb.irls, {"scale": "std"}, (13.2, 4.37)),
    "mad": (lb.irls, {"scale": "mad"}, (8.5, 0.47)),
    "known": (lb.irls, {"scale": 1.0}, (0.985, 0.46)),
    "known, one weight per spot": (lb.irls, {"scale": 1.0, "group": True}, (0.89, 0.44)),
}


@pytest.mark.parametrize(("place", "count"), [(0, 4), (1, 8)])
@pytest.mark.parametrize("name", RING)
def test_one_bad_spot_on_a_ring(name, place, count):
    solve, options, expected = RING[name]
    options = options | ({} if solve is lb.lstsq else ANY_NUMBER)
    if "group" in options:
        options["group"] = np.repeat(np.arange(count), 2)
    design, y = ring(count, 4000, seed=count)
    assert error(solve(design, y, **options)) == pytest.approx(expected[place], rel=0.04)


@pytest.mark.parametrize(("frames", "expected"), [(3, (17.0, 7.2, 0.56)), (10, (10.0, 3.2, 0.31))])
def test_stacked_frames_of_two_spots(frames, expected):
    rng = np.random.default_rng(frames)
    pair = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, -1.0]])
    trials, bad = 4000, max(1, frames // 5)
    y = rng.standard_normal((trials, frames, 2, 2))
    y[:, :bad, 0, 0] += 100.0
    design, y = np.tile(pair, (frames, 1)), y.reshape(trials, -1)
    found = [
        error(lb.lstsq(design, y)),
        *(error(lb.irls(design, y, scale=s, **ANY_NUMBER)) for s in ("std", "mad")),
    ]
    np.testing.assert_allclose(found, expected, rtol=0.06)


def test_two_spots_of_the_paper_cannot_be_told_apart():
    """liu2026: rows 1 and 3 are identical, residuals are (d, 0, -d, 0), and reweighting moves
    nothing.
    """
    z, x, y = -475.0, 5.0, 75.0
    design = np.array([[0, z, -y], [-z, 0, x], [0, z, -y], [-z, 0, -x]])
    shifts = np.random.default_rng(5).normal(0.0, 4.5e-4, (5000, 4))
    for scale in ("std", "std1", "mad"):
        robust = lb.irls(design, shifts, scale=scale)
        np.testing.assert_allclose(robust.x, lb.lstsq(design, shifts).x, atol=1e-15)
        np.testing.assert_allclose(robust.residuals[:, 0], -robust.residuals[:, 2], atol=1e-16)
        np.testing.assert_allclose(robust.residuals[:, [1, 3]], 0.0, atol=1e-16)
