"""Bad pixels, saturated cores and neighbours: what is masked, what it costs, and what is flagged by
mistake.
"""

import numpy as np
import pytest
from noisy_spots import CAMERA, rms, spots

import losbench as lb

SIDE = 43
METHODS = (lb.Weighted(2.0, window=13), lb.Likelihood(2.0, window=13))


def frames(count=200, *, sigma=2.0, amplitude=1000.0, noise=3.0, seed=0, also=None):
    """Frames (F, 43, 43) of one spot, or of one and another ``also`` (brightness, pixels away)."""
    rng = np.random.default_rng(seed)
    xy = SIDE // 2 + rng.uniform(-0.5, 0.5, (count, 1, 2))
    light = lb.render_spots(xy, amplitude * 2 * np.pi * sigma**2, sigma, (SIDE, SIDE))
    if also is not None:
        share, away = also
        turn = rng.uniform(0.0, 2.0 * np.pi, (count, 1))
        other = xy + away * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        flux = share * amplitude * 2 * np.pi * sigma**2
        light += lb.render_spots(other, flux, sigma, (SIDE, SIDE))
    return (light + rng.normal(100.0, noise, light.shape)).astype(np.float32), xy


def share(found, flag):
    return float((found.flags & flag > 0).mean())


def dead(image, y, x):
    image[:, y, x] = 0.0


def hot(image, y, x):
    image[:, y, x] += 600.0


def unread(image, y, x):
    image[:, y, x] = np.nan


def bright_row(image, y, x):
    image[:, y] += 80.0


def dead_column(image, y, x):
    image[:, :, x] = 0.0


@pytest.mark.parametrize("method", METHODS, ids=["weighted", "likelihood"])
@pytest.mark.parametrize(
    ("spoil", "count"),
    [(dead, 1), (hot, 1), (unread, 1), (bright_row, 13), (dead_column, 13)],
)
@pytest.mark.parametrize(("dx", "dy"), [(0, 0), (3, -1), (1, 2)])
def test_a_bad_pixel_costs_less_than_one_error_and_is_counted(method, spoil, count, dx, dy):
    image, xy = frames()
    spoil(image, SIDE // 2 + dy, SIDE // 2 + dx)
    found = lb.centroid(image, np.full((200, 1, 2), SIDE // 2), method=method)
    error = found.xy - xy
    assert np.abs(error.mean(axis=(0, 1))).max() < found.sigma_xy.mean()
    assert rms(error / found.sigma_xy) == pytest.approx(1.0, abs=0.15)
    assert share(found, lb.SpotFlag.BAD_PIXEL) > 0.99
    assert np.median(found.n_bad) == count
    assert share(found, lb.SpotFlag.NEIGHBOUR) < 0.02


@pytest.mark.parametrize("sigma", [2.0, 4.0])
@pytest.mark.parametrize("spoil", [dead, hot, bright_row, dead_column])
@pytest.mark.parametrize(("dx", "dy"), [(0, 0), (3, -1), (1, 2)])
def test_a_moment_takes_a_bad_pixel_from_the_template_and_the_other_side(sigma, spoil, dx, dy):
    """A pixel that is too bright in the very middle is like its other side, and does little harm:
    it is noticed in seven of ten.
    """
    image, xy = frames(sigma=sigma)
    spoil(image, SIDE // 2 + dy, SIDE // 2 + dx)
    method = lb.EIWA(int(6 * sigma) | 1)
    detector = lb.Gain(0.0, 0.0)
    found = lb.centroid(image, np.full((200, 1, 2), SIDE // 2), method=method, detector=detector)
    error = found.xy - xy
    assert np.abs(error.mean(axis=(0, 1))).max() < 0.5 * found.sigma_xy.mean()
    assert rms(error / found.sigma_xy) == pytest.approx(1.0, abs=0.15)
    hidden = (dx, dy) == (0, 0) and spoil in (hot, bright_row)
    assert share(found, lb.SpotFlag.BAD_PIXEL) > (0.7 if hidden else 0.98)
    assert share(found, lb.SpotFlag.NEIGHBOUR) < 0.02


@pytest.mark.parametrize("method", [*METHODS, lb.EIWA(13)], ids=["weighted", "likelihood", "eiwa"])
@pytest.mark.parametrize(("dx", "dy"), [(0, 0), (1, 1), (2, -1), (-4, 1), (3, 4)])
def test_dead_pixels_side_by_side_are_told_in_the_core_as_in_the_wings(method, dx, dy):
    """Four that read zero, as no light of another spot does."""
    image, xy = frames(sigma=2.0, amplitude=2e4)
    for x, y in ((0, 0), (1, 0), (1, 1), (2, 1)):
        dead(image, SIDE // 2 + dy + y, SIDE // 2 + dx + x)
    found = lb.centroid(image, np.full((200, 1, 2), SIDE // 2), method=method)
    assert share(found, lb.SpotFlag.BAD_PIXEL) == 1.0
    if method in METHODS:
        assert rms((found.xy - xy) / found.sigma_xy) < 1.5


def test_a_pair_of_dead_pixels_beside_a_spot_narrower_than_a_sixth_of_the_window_is_told():
    image, xy = frames(sigma=1.24, amplitude=4e4, noise=5.0)
    for x, y in ((-3, -1), (-4, 0)):
        dead(image, SIDE // 2 + y, SIDE // 2 + x)
    detector = lb.Gain(0.0, 0.0)
    found = lb.centroid(image, np.rint(xy), method=lb.EIWA(9), detector=detector)
    near = xy[:, 0, 0] < SIDE // 2
    assert near.sum() > 50 and (found.flags[near] & lb.SpotFlag.BAD_PIXEL > 0).all()


def test_a_moment_shares_in_the_margin_and_is_rid_of_a_hot_pixel_there():
    image, xy = frames()
    hot(image, SIDE // 2 + 3, SIDE // 2 + 7)
    whole = np.full((200, 1, 2), SIDE // 2)
    detector = lb.Gain(0.0, 0.0)
    found = lb.centroid(image, whole, method=lb.EIWA(13), detector=detector)
    assert share(found, lb.SpotFlag.BAD_PIXEL) > 0.98 and np.median(found.n_bad) == 1
    error = found.xy - xy
    assert np.abs(error.mean(axis=(0, 1))).max() < 0.5 * found.sigma_xy.mean()
    assert rms(error / found.sigma_xy) == pytest.approx(1.0, abs=0.15)
    # A template stays within its window.
    fitted = lb.centroid(image, whole, method=METHODS[0], detector=detector)
    assert share(fitted, lb.SpotFlag.BAD_PIXEL) == 0.0


@pytest.mark.parametrize("window", [5, 7, 9])
def test_a_moment_keeps_light_of_another_spot_and_is_flagged(window):
    """Sharp and bright ones, where each pixel of the other stands out of a template by itself."""
    rng = np.random.default_rng(31)
    xy = np.array([[12.0, 11.0]]) + rng.uniform(-0.5, 0.5, (40, 1, 2))
    light = lb.render_spots(xy, 9e7, 0.6, (23, 25))
    light += lb.render_spots(xy + np.array([2.2, 0.6]), 4.5e7, 0.6, (23, 25)) + 4e4
    image = ((light + np.sqrt(light) * rng.standard_normal(light.shape)) / 2e3).astype(np.float32)
    detector = lb.Gain(5e-4, 0.0)
    found = lb.centroid(image, np.rint(xy), method=lb.EIWA(window), detector=detector)
    assert share(found, lb.SpotFlag.NEIGHBOUR) > 0.95
    letter = lb.EIWA(window, stop="step", tolerance=1e-6, max_iter=500)
    kept = lb.centroid(image, np.rint(xy), method=letter, detector=detector)
    assert np.abs(found.xy - kept.xy).max() < 2e-3


@pytest.mark.parametrize(("sigma", "snr"), [(1.5, 100), (2.0, 30), (3.0, 10)])
@pytest.mark.parametrize("kind", [lb.Weighted, lb.Likelihood, lb.EIWA])
def test_clean_spots_are_left_alone(kind, sigma, snr):
    """At most 5 in 10 000 masked, less than 1 in 200 with a neighbour."""
    image, xy, _ = spots(sigma, snr, n=2000, seed=3)
    method = kind(window=int(6 * sigma) | 1)
    for detector in (CAMERA, None):
        found = lb.centroid(image, np.rint(xy), method=method, detector=detector)
        assert (found.flags & lb.SpotFlag.BAD_PIXEL > 0).sum() <= 1
        assert share(found, lb.SpotFlag.NEIGHBOUR) < 0.005


@pytest.mark.parametrize("beta", [1.5, 2.5, 4.0])
def test_wings_of_a_moffat_are_no_bad_pixels(beta):
    rng = np.random.default_rng(1)
    fine = (np.arange(5 * SIDE) + 0.5) / 5 - 0.5
    xy = SIDE // 2 + rng.uniform(-0.5, 0.5, (300, 1, 2))
    square = (fine[:, None] - xy[..., 1:]) ** 2 + (fine - xy[..., :1]) ** 2
    light = 1000.0 * (1.0 + square / 9.0) ** -beta
    image = light.reshape(300, SIDE, 5, SIDE, 5).mean(axis=(2, 4))
    image = (image + rng.normal(100.0, 3.0, image.shape)).astype(np.float32)
    for method in (lb.Weighted(window=13), lb.Likelihood(window=13)):
        found = lb.centroid(image, np.rint(xy), method=method)
        assert share(found, lb.SpotFlag.BAD_PIXEL) == 0.0
        assert share(found, lb.SpotFlag.NEIGHBOUR) < 0.005


FAINTER = [(0.03, 6), (0.03, 7), (0.1, 5), (0.3, 4), (0.3, 7), (0.3, 9)]
ALIKE = [(1.0, 6.5), (1.0, 7), (1.0, 8), (1.0, 9), (1.0, 11)]
CAPTURING = [(3.0, 4), (3.0, 6), (3.0, 8), (3.0, 9), (3.0, 11), (10.0, 4), (10.0, 7), (10.0, 11)]


@pytest.mark.parametrize("also", [*FAINTER, *ALIKE, *CAPTURING])
@pytest.mark.parametrize("method", [*METHODS, lb.EIWA(13)], ids=["weighted", "likely", "eiwa"])
def test_light_of_another_spot_is_flagged_and_not_masked(method, also):
    """Fainter ones beside the spot, and brighter ones that have captured it, or half of it."""
    image, xy = frames(also=also)
    # The other spot is elsewhere in every frame, which pairs of frames would take for noise.
    found = lb.centroid(image, np.rint(xy), method=method, detector=lb.Gain(0.0, 0.0))
    least = 0.8 if isinstance(method, lb.EIWA) and also[0] == 0.03 else 0.98
    assert share(found, lb.SpotFlag.NEIGHBOUR) > least


@pytest.mark.parametrize("method", [*METHODS, lb.EIWA(13)], ids=["weighted", "likely", "eiwa"])
def test_what_looks_like_one_spot_is_not_told_to_be_two(method):
    """The limits that `centroid` states: 3 % of the light two sigma away, and as bright a one there;
    a template of common width then does not fit.
    """
    for also in ((0.03, 4), (1.0, 4)):
        image, xy = frames(also=also)
        found = lb.centroid(image, np.rint(xy), method=method, detector=lb.Gain(0.0, 0.0))
        assert share(found, lb.SpotFlag.NEIGHBOUR) < 0.1
        if isinstance(method, lb.Weighted):
            assert share(found, lb.SpotFlag.MISFIT) == (1.0 if also[0] == 1.0 else 0.0)


@pytest.mark.parametrize("method", [*METHODS, lb.EIWA(13)], ids=["weighted", "likely", "eiwa"])
def test_a_start_far_off_a_spot_that_stands_alone_makes_no_neighbour(method):
    image, xy = frames(60)
    found = lb.centroid(image, np.rint(xy) + np.array([8.0, 0.0]), method=method)
    assert share(found, lb.SpotFlag.NOT_CONVERGED) == 1.0
    assert share(found, lb.SpotFlag.NEIGHBOUR) == 0.0


SHAPES = {
    "ring": lambda r, _: np.exp(-0.5 * ((r - 5.0) / 0.8) ** 2),
    "uneven ring": lambda r, turn: (
        (1.0 + 0.2 * np.cos(2.0 * turn)) * np.exp(-0.5 * ((r - 5.0) / 0.8) ** 2)
    ),
    "disc": lambda r, _: 1.0 * (r < 5.0),
    "annulus": lambda r, _: 1.0 * ((r > 2.5) & (r < 6.0)),
}


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("kind", [lb.Weighted, lb.Likelihood, lb.EIWA])
def test_a_shape_that_is_no_gaussian_has_no_neighbour(kind, shape):
    """Dark in the middle as between two tops, and badly fitted, but alike on both sides."""
    rng = np.random.default_rng(2)
    fine = (np.arange(5 * SIDE) + 0.5) / 5 - 0.5
    xy = SIDE // 2 + rng.uniform(-0.5, 0.5, (200, 1, 2))
    x, y = fine - xy[..., :1], fine[:, None] - xy[..., 1:]
    light = 1000.0 * SHAPES[shape](np.hypot(x, y), np.arctan2(y, x))
    image = light.reshape(200, SIDE, 5, SIDE, 5).mean(axis=(2, 4))
    image = (image + rng.normal(100.0, 3.0, image.shape)).astype(np.float32)
    found = lb.centroid(image, np.rint(xy), method=kind(window=21), detector=lb.Gain(0.0, 0.0))
    assert share(found, lb.SpotFlag.NEIGHBOUR) < 0.005


@pytest.mark.parametrize("peak", [0.9, 1.5, 4.0])
def test_a_saturated_core_is_masked_and_the_error_stays_honest(peak):
    rng = np.random.default_rng(4)
    xy = SIDE // 2 + rng.uniform(-0.5, 0.5, (600, 1, 2))
    detector = lb.Detector(gain_e_per_dn=4.0, read_noise_e=12.0, offset_dn=50.0, bits=12)
    flux = 4.0 * peak * 4045.0 * 2 * np.pi * 1.5**2
    light = lb.render_spots(xy, flux, 1.5, (SIDE, SIDE)) + 100.0
    image = detector.expose(light, rng)
    method = lb.Likelihood(1.5, window=11)
    found = lb.centroid(image, np.rint(xy), method=method, detector=detector)
    assert share(found, lb.SpotFlag.SATURATED) == (1.0 if peak > 1.2 else 0.0)
    assert rms((found.xy - xy) / found.sigma_xy) == pytest.approx(1.0, abs=0.15)
    assert 1e3 * rms(found.xy - xy) < 8.0
