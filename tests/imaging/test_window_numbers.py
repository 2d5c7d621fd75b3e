"""What a window makes of what it sees."""

import numpy as np
import pytest

from losbench.imaging.noise import PixelNoise
from losbench.imaging.protocols import Windows
from losbench.imaging.window import Look, WindowFit, window_estimate

SIDE = 5


def estimate(contraction, *, total=100.0, moved=True, remaining=0.0, floor=4.0):
    noise = PixelNoise(np.full(1, floor), 0.0, np.array([[0.3, 0.02, 0.05]]))
    zeros = np.zeros((1, 2))
    windows = Windows(np.zeros((1, 7, 7)), SIDE, zeros, zeros.astype(int), noise, zeros)
    one = np.ones(1)
    seen = Look(total * one, zeros, np.array([contraction]))
    fit = WindowFit(zeros, zeros + remaining, one.astype(int), one > 0, seen)
    return window_estimate(windows, fit, moved=moved)


@pytest.mark.parametrize(
    ("contraction", "slow"),
    [((0.84, 0.84), False), ((0.86, 0.1), True), ((0.1, 0.86), True), ((0.86, -3.0), True)],
)
def test_a_window_is_slow_where_its_centroid_follows_it_along_either_axis(contraction, slow):
    assert estimate(contraction).slow.tolist() == [slow]


@pytest.mark.parametrize("moved", [True, False])
@pytest.mark.parametrize("contraction", [0.0, 0.5, 0.8499, 0.9, 2.0])
def test_the_error_of_a_centroid_is_that_of_pixels_and_slopes_drawn_out_by_its_contraction(
    contraction, moved
):
    """1 / (1 - contraction), to 1 / 0.15; a window that stays draws nothing out."""
    found = estimate((contraction, 0.0), moved=moved, remaining=0.01)
    arms = np.arange(-2.0, 3.0)
    pixels = 4.0 * SIDE * (arms**2).sum()
    drawn = 1.0 / max(1.0 - contraction, 0.15) if moved else 1.0
    for k, (slope, times) in enumerate(((0.02, drawn), (0.05, 1.0))):
        moment = pixels + (SIDE * (arms**2).sum()) ** 2 * slope
        error = np.sqrt(moment * (times / 100.0) ** 2 + 0.01**2)
        assert found.sigma[0, k] == pytest.approx(error)
    assert found.sigma_flux[0] == pytest.approx(np.sqrt(4.0 * SIDE**2 + 0.3 * SIDE**4))


def test_without_noise_there_is_no_error():
    noise_free = estimate((0.0, 0.0), floor=-1.0)
    assert noise_free.sigma_flux[0] == pytest.approx(np.sqrt(0.3 * SIDE**4 - SIDE**2))
    assert estimate((0.0, 0.0), floor=-1e3).sigma_flux[0] == 0.0
    assert (estimate((0.0, 0.0), floor=-1e3).sigma == 0.0).all()
