"""The steps of EIWA: how far a window moves, and what is left of its way."""

import numpy as np
import pytest

import losbench as lb
from losbench.imaging.eiwa import _newton, _paper
from losbench.imaging.noise import PixelNoise
from losbench.imaging.protocols import Windows


@pytest.mark.parametrize(
    ("step", "ahead", "near", "move", "left"),
    [
        (0.2, 0.3, True, 0.3, 0.03),  # a tenth of a Newton step
        (0.2, 0.3, False, 0.2, 0.13),
        (-0.2, -0.3, False, -0.2, -0.13),
        (0.9, 1.4, True, 1.0, 0.54),  # a pixel at most
        (-0.9, -1.4, True, -1.0, -0.54),
        (1.7, 0.5, False, 1.0, -0.45),
    ],
)
def test_a_newton_step_is_a_pixel_at_most_and_leaves_a_tenth(step, ahead, near, move, left):
    given = np.array([[step]]), np.array([[ahead]]), np.array([[near]])
    moved, rest, small = _newton(*given)
    assert moved[0, 0] == pytest.approx(move) and rest[0, 0] == pytest.approx(left)
    assert small is rest


def test_the_paper_s_step_is_the_centroid_s_and_leaves_the_rest_of_the_way():
    step, ahead = np.array([[0.2, -0.3]]), np.array([[0.5, -0.4]])
    move, left, small = _paper(step, ahead, np.ones((1, 2), bool))
    assert move is step and small is step
    np.testing.assert_allclose(left, [[0.3, -0.1]])


@pytest.mark.parametrize("most", [1, 2, 3, 5])
def test_what_is_left_is_the_way_to_where_a_window_rests(most):
    """To a tenth of it, where the contraction changes little on the way."""
    signal = lb.render_spots([[8.4, 7.8]], 1e4, 2.0, (17, 17))[None]
    zeros = np.zeros((1, 2))
    noise = PixelNoise(np.ones(1), 0.0, np.zeros((1, 3)))
    windows = Windows(signal, 15, zeros, zeros.astype(int), noise, zeros + np.nan)
    signal[:, :, 4] += 150.0  # light at one side, which the centroid follows
    *_, rest = lb.EIWA(15, stop="step", tolerance=1e-9, max_iter=400).steps(windows)
    assert rest.converged.all()
    *_, on_the_way = lb.EIWA(15, stop="step", tolerance=1e-9, max_iter=most).steps(windows)
    assert not on_the_way.converged.any() and on_the_way.n_iter.tolist() == [most]
    way = rest.centroid - on_the_way.centroid
    np.testing.assert_allclose(on_the_way.remaining, way, atol=0.1 * np.abs(way).max())
