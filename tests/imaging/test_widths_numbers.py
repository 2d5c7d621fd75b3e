"""Whose width counts, how many windows are fitted, and how much of one may be unread."""

from types import SimpleNamespace

import numpy as np
import pytest

import losbench as lb
from losbench.imaging import template, widths
from losbench.imaging.groups import grouped
from losbench.imaging.noise import PixelNoise
from losbench.imaging.protocols import Windows
from losbench.imaging.template import TemplateFit
from losbench.imaging.widths import SpotFits, _chosen, _weighted_median, spot_fits

RNG = np.random.default_rng(71)


def test_a_weighted_median_is_that_of_values_repeated_as_often():
    values, weight = RNG.random((30, 2)), RNG.integers(1, 9, 30)
    weight[0] += 1 - weight.sum() % 2  # an odd number of them has a median among them
    found = _weighted_median(values, weight.astype(float))
    np.testing.assert_allclose(found, np.median(np.repeat(values, weight, axis=0), axis=0))


def test_of_two_halves_of_the_weight_the_lower_value_is_the_median():
    found = _weighted_median(np.array([[3.0, 1.0], [2.0, 5.0]]), np.array([1.0, 1.0]))
    assert found.tolist() == [2.0, 1.0]


def fits_of(count, spot, width, significance, side=13):
    m = len(spot)
    zeros = np.zeros((m, 2))
    noise = PixelNoise(np.ones(m), 0.0, np.zeros((m, 3)))
    windows = Windows(np.zeros((m, side + 2, side + 2)), side, zeros, zeros, noise, zeros)
    fit = TemplateFit(
        zeros,
        np.stack([width, 2.0 * np.asarray(width)], axis=-1),
        np.ones(m),
        np.ones((m, 3)),
        np.ones(m, int),
        np.ones(m, bool),
    )
    return SpotFits(count, np.array(spot), windows, fit, np.array(significance, float))


@pytest.mark.parametrize(("frames", "own"), [(3, False), (4, True)])
def test_a_spot_in_four_frames_has_a_width_of_its_own(frames, own):
    spot = [0] * frames + [1] * 9
    found = fits_of(2, spot, [1.0] * frames + [2.0] * 9, [50.0] * len(spot)).widths()
    assert found[0].tolist() == ([1.0, 2.0] if own else [2.0, 4.0])
    assert found[1].tolist() == [2.0, 4.0]


@pytest.mark.parametrize(("significance", "votes"), [(9.9, False), (10.0, True)])
def test_a_spot_fainter_than_ten_errors_has_no_vote(significance, votes):
    found = fits_of(2, [0, 1], [1.0, 2.0], [significance, 5.0]).widths()
    assert found.tolist() == [[1.0, 2.0]] * 2 if votes else [[13 / 6.0] * 2] * 2


def test_votes_weigh_as_much_as_they_tell():
    """The square of flux over error: 20^2 is more than 2 x 14^2."""
    for bright, width in ((20.0, 1.0), (19.0, 2.0)):
        found = fits_of(3, [0, 1, 2], [1.0, 2.0, 2.0], [bright, 14.0, 14.0]).widths()
        assert found[0, 0] == width


@pytest.mark.parametrize(
    ("frames", "spots", "windows"),
    [
        (1, 64, 64),
        (1, 65, 64),
        (3, 100, 64),
        (3, 30, 60),
        (4, 100, 400),
        (4, 500, 400),
        (70, 1, 64),
        (64, 1, 64),
        (100, 8, 400),
        (100, 7, 399),
        (10, 400, 400),
    ],
)
def test_up_to_400_windows_tell_the_widths_or_64_of_fewer_than_four_frames(frames, spots, windows):
    frame, spot = (v.ravel() for v in np.indices((frames, spots)))
    some = _chosen(frame, spot, spots)
    assert len(some) == windows
    assert {0, spots - 1} <= set(spot[some].tolist()) and 0 in frame[some]


# What may be unread


@pytest.mark.parametrize(("unread", "measured"), [(25, True), (26, False)])
@pytest.mark.parametrize("kind", [lb.Weighted, lb.Likelihood])
def test_a_template_goes_without_fifteen_of_a_hundred_pixels(kind, unread, measured):
    """Of 169 pixels 25."""
    image = lb.render_spots([[40.0, 30.0]], 3e4, 2.0, (60, 80)) + 100.0
    image += np.random.default_rng(2).normal(0.0, 2.0, image.shape)
    rows, columns = np.divmod(np.arange(unread), 13)
    image[24 + rows, 34 + columns] = np.nan
    found = lb.centroid(image, [[40, 30]], method=kind(2.0, window=13))
    assert np.isfinite(found.xy).all() == measured
    assert found.n_bad.tolist() == [unread if measured else 0]
    flags = lb.SpotFlag(int(found.flags[0]))
    assert (lb.SpotFlag.MISSING in flags) == (not measured)
    assert (lb.SpotFlag.BAD_PIXEL in flags) == measured


def test_a_moment_goes_without_none():
    image = lb.render_spots([[40.0, 30.0]], 3e4, 2.0, (60, 80)) + 100.0
    image += np.random.default_rng(2).normal(0.0, 2.0, image.shape)
    assert np.isfinite(lb.centroid(image, [[40, 30]], method=lb.EIWA(13)).xy).all()
    image[24, 34] = np.nan
    found = lb.centroid(image, [[40, 30]], method=lb.EIWA(13))
    assert np.isnan(found.xy).all() and found.flags[0] & lb.SpotFlag.MISSING


# Saturated cores


@pytest.mark.parametrize(("full", "method"), [(2, lb.Weighted), (3, lb.Likelihood)])
def test_more_than_one_in_twenty_saturated_spots_are_fitted_with_free_widths(full, method):
    """Of 40."""
    xy = np.stack(np.meshgrid(20.0 + 30 * np.arange(8), 20.0 + 30 * np.arange(5)), -1)
    flux = np.full(40, 2e4)
    flux[:full] = 1.2e5
    light = lb.render_spots(xy.reshape(-1, 2), flux, 2.0, (160, 250)) + 50.0
    image = np.minimum(light + RNG.normal(0.0, 3.0, light.shape), 3000.0)
    found = lb.centroid(
        image, xy.reshape(-1, 2), method=lb.AutoCentroid(window=13), full_scale_dn=3000.0
    )
    assert type(found.method) is method, found.reason


def test_windows_are_fitted_from_a_third_of_their_side_at_most_and_a_sixth_wide(monkeypatch):
    """In twelve steps to 1e-5 pixels squared, wherever a first centroid may lie."""
    asked = []

    def fitted(windows, **options):
        asked.append((windows, options))
        return template.fit_template(windows, **options)

    monkeypatch.setattr(widths, "fit_template", fitted)
    monkeypatch.setattr(
        widths, "grey", lambda signal, *_: SimpleNamespace(centroid=np.array([[9.0, -9.0]]))
    )
    frame = lb.render_spots([[30.0, 30.0]], 1e4, 1.5, (60, 60))[None] + 10.0
    places = np.array([[[30.0, 30.0]]])
    (group,) = grouped(frame, places, np.array([15]), lb.Weighted(), lb.Ring(), None, None)
    spot_fits(group, frame)
    ((windows, options),) = asked
    assert windows.start.tolist() == [[5.0, -5.0]] and windows.leave == 5.0
    assert (windows.width == 2.5).all() and windows.side == 15
    assert options == {"free": True, "tolerance": 1e-5, "max_iter": 12}
