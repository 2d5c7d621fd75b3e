"""Widths of spots from half a pixel to 150, and the windows that follow from them.

Seeds were fixed before the first run.
"""

import numpy as np
import pytest

import losbench as lb
from losbench.imaging import moment
from losbench.imaging.aperture import aperture_sigma
from losbench.imaging.moment import _kept_variance
from losbench.imaging.sizes import default_window, spot_sigma


def spot(sigma, over_noise, seed, margin=4.5):
    rng = np.random.default_rng(seed)
    side = 2 * int(max(30, margin * np.max(sigma))) + 1
    xy = side // 2 + rng.uniform(-0.5, 0.5, (1, 2))
    flux = over_noise * 2 * np.pi * np.prod(np.broadcast_to(sigma, 2))
    image = lb.render_spots(xy, flux, sigma, (side, side + 6)) + rng.normal(
        50.0, 1.0, (side, side + 6)
    )
    return image.astype(np.float32), np.rint(xy)


@pytest.mark.parametrize("sigma", [1.5, 2.0, 3.0, 5.0, 8.0, 15.0, 30.0, 60.0, 100.0])
@pytest.mark.parametrize("over_noise", [30.0, 300.0])
def test_the_width_is_found_within_five_percent(sigma, over_noise):
    some = 24 if sigma < 4 else 3
    found = [spot_sigma(*spot(sigma, over_noise, 4000 + k)) / sigma for k in range(some)]
    np.testing.assert_allclose(found, 1.0, atol=0.05)
    assert np.mean(found) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("sigma", [1.0, 1.5, 2.0, 4.0])
@pytest.mark.parametrize("over_noise", [30.0, 100.0])
def test_the_width_of_a_gaussian_scatters_near_the_bound_of_cramer_and_rao(sigma, over_noise):
    """For one width, free place and light, white noise: the information of ln sigma is pi (sigma
    amplitude / noise)^2. Level and plane are found as well, which costs some of it.
    """
    found = [spot_sigma(*spot(sigma, over_noise, 7000 + k)) / sigma for k in range(80)]
    bound = 1.0 / (np.sqrt(np.pi) * sigma * over_noise)
    assert 0.85 < np.std(found) / bound < 1.45


def test_the_width_of_another_shape_is_that_of_its_second_moment():
    """A disc has a quarter of its diameter, a thin ring its radius over root two; a Gaussian that
    fits them best is a quarter wider.
    """
    y, x = np.mgrid[-60:61, -60:61]
    away = np.hypot(x, y)
    disc, ring = np.clip(12.5 - away, 0.0, 1.0), np.exp(-0.5 * ((away - 8.0) / 2.0) ** 2)
    noise = np.random.default_rng(8).normal(50.0, 1.0, away.shape)
    moment = float(np.sqrt((ring * away**2).sum() / ring.sum() / 2.0))
    for shape, sigma in ((disc, 12.0 / 2.0), (ring, moment)):
        found = spot_sigma(np.float32(100.0 * shape + noise), [[60.0, 60.0]])
        assert found == pytest.approx(sigma, rel=0.05)


def test_a_spot_of_half_a_pixel_and_one_of_150_are_seen_for_what_they_are():
    sharp = [spot_sigma(*spot(0.5, 100.0, 5000 + k)) for k in range(12)]
    assert 0.4 < np.median(sharp) < 0.8
    assert spot_sigma(*spot(150.0, 30.0, 1)) == pytest.approx(150.0, rel=0.03)


@pytest.mark.parametrize("sigma", [1.0, 2.0, 7.0, 33.0])
def test_the_window_is_the_first_odd_one_of_six_sigma_at_any_size(sigma):
    image, xy = spot(sigma, 1000.0, 6)
    window = default_window(image, xy)
    assert window % 2 == 1
    assert 0.97 * 6 * sigma - 0.3 <= window <= 1.03 * 6 * sigma + 2.0


@pytest.mark.parametrize(("x", "y"), [(2.0, 4.0), (12.0, 5.0), (30.0, 20.0)])
def test_a_spot_that_is_not_round_has_the_width_of_its_wider_axis(x, y):
    assert spot_sigma(*spot((x, y), 100.0, 2)) == pytest.approx(max(x, y), rel=0.04)


@pytest.mark.parametrize("away", [(5, 0), (3, -4), (8, 8)])
def test_a_hot_pixel_beside_a_spot_changes_nothing(away):
    image, xy = spot(2.0, 100.0, 3)
    x, y = xy[0].astype(int) + away
    clean = spot_sigma(image, xy)
    image[y, x] += 3000.0
    assert spot_sigma(image, xy) == pytest.approx(clean, rel=0.03)


@pytest.mark.parametrize(("share", "away"), [(1.0, 12), (1.0, 20), (10.0, 25), (10.0, 40)])
def test_a_neighbour_changes_little(share, away):
    image, xy = spot(2.0, 100.0, 4)
    turn = np.array([np.cos(0.7), np.sin(0.7)])
    other = lb.render_spots(xy + away * turn, share * 100 * 8 * np.pi, 2.0, image.shape)
    assert spot_sigma(image + other, xy) == pytest.approx(2.0, rel=0.1)


def beside(sigma, share, away, seed):
    """A spot of 100 noises with another so many sigma away."""
    image, xy = spot(sigma, 100.0, seed)
    turn = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi)
    other = xy + away * sigma * np.array([np.cos(turn), np.sin(turn)])
    return image + lb.render_spots(other, share * 200 * np.pi * sigma**2, sigma, image.shape), xy


@pytest.mark.parametrize("share", [0.3, 1.0])
@pytest.mark.parametrize("sigma", [1.0, 1.5, 2.0, 3.0])
def test_a_neighbour_at_five_sigma_is_told_by_the_dip_and_one_at_three_is_not(sigma, share):
    found = {
        away: [spot_sigma(*beside(sigma, share, away, 8800 + k)) / sigma for k in range(24)]
        for away in (3.0, 5.0, 6.0, 8.0)
    }
    assert np.median(found[3.0]) > 1.4
    for away in (5.0, 6.0, 8.0):
        assert np.median(found[away]) == pytest.approx(1.0, abs=0.12)


def test_a_tail_is_light_of_the_spot_itself(monkeypatch):
    """Brighter than the other side, but without a dip before it."""
    image, xy = spot(1.5, 100.0, 7)
    for k, share in enumerate((0.6, 0.35, 0.2), 1):
        width = 1.5 + 0.5 * k
        flux = share * 200 * np.pi * width**2
        image = image + lb.render_spots(xy + np.array([2.0 * k, 0.0]), flux, width, image.shape)
    found = spot_sigma(image, xy)
    monkeypatch.setattr(moment, "without_others", lambda light, *_: light)
    assert found == spot_sigma(image, xy) > 2.8


def test_a_gradient_a_corner_and_frames_that_move_change_little():
    image, xy = spot(3.0, 100.0, 5)
    ramp = 2.0 * np.arange(image.shape[1])
    assert spot_sigma(image + ramp, xy) == pytest.approx(3.0, rel=0.05)
    assert spot_sigma(image[20:, 20:], xy - 20.0) == pytest.approx(3.0, rel=0.05)
    stack = np.stack([np.roll(image, (k, -k), axis=(0, 1)) for k in range(4)])
    places = xy + np.arange(4)[:, None, None] * np.array([-1.0, 1.0])
    assert spot_sigma(stack, places) == pytest.approx(3.0, rel=0.03)


def test_where_nothing_stands_out_there_is_no_width():
    noise = np.random.default_rng(1).normal(100.0, 5.0, (90, 120))
    assert np.isnan(aperture_sigma(noise[None], np.array([0]), np.array([[60, 45]])))
    assert np.isnan(spot_sigma(np.full((60, 60), 7.0), [[30.0, 30.0]]))


def test_a_gaussian_cut_at_three_sigma_keeps_this_part_of_its_variance():
    assert _kept_variance(np.array([3.0]))[0] == pytest.approx(0.9733, abs=1e-4)
    x = np.linspace(-1.5, 1.5, 200_001)
    bell = np.exp(-0.5 * x**2)
    assert _kept_variance(np.array([1.5]))[0] == pytest.approx(
        (bell * x**2).sum() / bell.sum(), rel=1e-4
    )


def test_the_width_of_a_real_beam_is_that_of_its_iterated_moment(real_data):
    """Above the level near the beam, 7 DN; half a DN less gives a point 0.7 px away."""
    import cv2

    image = cv2.imread(str(real_data("laser-beam") / "t-414mm.pgm"), cv2.IMREAD_UNCHANGED)
    found = lb.centroid(image, lb.find_spots(image)[:1])
    np.testing.assert_allclose(found.xy, [[480.5, 387.3]], atol=0.5)
    assert found.flags[0] & lb.SpotFlag.LOWER_BOUND
    assert found.window / 6 == pytest.approx(36.5, rel=0.06)


@pytest.mark.parametrize(("away", "seen"), [(18, False), (40, False), (9, True)])
def test_a_start_beside_a_spot_has_no_width_of_its_own(away, seen):
    """The aperture grows until it sees something: a spot further off is another one."""
    image, xy = spot(2.0, 200.0, 9, margin=40.0)
    found = spot_sigma(image, xy + np.array([away, 0]))
    assert (found == pytest.approx(2.0, rel=0.05)) if seen else np.isnan(found)
    beam, xy = spot(20.0, 100.0, 9)
    assert spot_sigma(beam, xy + np.array([14, -14])) == pytest.approx(20.0, rel=0.05)
