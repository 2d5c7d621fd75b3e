"""Limits of a detector, from either side."""

import numpy as np
import pytest

import losbench as lb
from losbench.imaging.detector import _splitmix64

SHAPE = (6, 8)


@pytest.mark.parametrize(
    ("x", "y", "seen"),
    [
        (0, 0, True),
        (7, 5, True),
        (7, 0, True),
        (0, 5, True),
        (-1, 2, False),
        (8, 2, False),
        (3, -1, False),
        (3, 6, False),
    ],
)
@pytest.mark.parametrize("origin", [(0, 0), (10, 20)])
def test_a_hot_pixel_is_in_a_window_up_to_its_border(x, y, seen, origin):
    camera = lb.Detector(hot_pixels=((x + origin[0], y + origin[1], 1e4),))
    frame = camera.expose(np.zeros(SHAPE), 1, origin=origin)
    assert (frame > 9000).sum() == seen
    if seen:
        assert frame[y, x] > 9000


def test_windows_of_one_call_have_each_their_own_hot_pixels():
    camera = lb.Detector(hot_pixels=((3, 2, 1e4), (12, 4, 2e4)))
    frames = camera.expose(np.zeros((2, *SHAPE)), 1, origin=[(0, 0), (10, 1)])
    assert np.argwhere(frames > 9000).tolist() == [[0, 2, 3], [1, 3, 2]]
    twice = lb.Detector(hot_pixels=((3, 2, 1e4), (3, 2, 1e4))).expose(np.zeros(SHAPE), 1)
    assert twice[2, 3] == pytest.approx(2e4, rel=0.05)


@pytest.mark.parametrize(
    ("field", "least", "below"),
    [
        ("gain_e_per_dn", 1e-9, 0.0),
        ("read_noise_e", 0.0, -1e-9),
        ("offset_dn", 0.0, -1e-9),
        ("full_well_e", 1e-9, 0.0),
        ("bits", 8, 7),
        ("prnu", 0.0, -1e-9),
        ("prnu_seed", 0, -1),
    ],
)
def test_the_least_that_a_field_may_be(field, least, below):
    assert getattr(lb.Detector(**{field: least}), field) == least
    with pytest.raises(ValueError, match=field):
        lb.Detector(**{field: below})


@pytest.mark.parametrize(
    ("field", "most", "above"),
    [("bits", 16, 17), ("prnu", 0.5, 0.51), ("prnu_seed", 2**63 - 1, 2**63)],
)
def test_the_most_that_a_field_may_be(field, most, above):
    assert getattr(lb.Detector(**{field: most}), field) == most
    with pytest.raises(ValueError, match=field):
        lb.Detector(**{field: above})


def test_hot_pixels_have_no_negative_light():
    assert lb.Detector(hot_pixels=[(1, 2, 0.0)]).hot_pixels == [(1, 2, 0.0)]
    for pixel in ((1, 2, -1e-9), (1, np.nan, 5.0), (1, 2), "ab", (np.inf, 2, 5.0)):
        with pytest.raises(ValueError, match="hot_pixels must be"):
            lb.Detector(hot_pixels=(pixel,))


def test_a_full_well_and_a_converter_end_where_the_first_of_them_does():
    for well, bits, full in ((1000.0, 16, 600.0), (1e6, 12, 4095.0), (np.inf, 10, 1023.0)):
        camera = lb.Detector(gain_e_per_dn=2.0, offset_dn=100.0, full_well_e=well, bits=bits)
        assert camera.full_scale_dn == full
        assert camera.expose(np.full(SHAPE, 1e7), 1).max() == full


def test_the_variance_of_a_reading_is_shot_noise_read_noise_and_rounding():
    camera = lb.Detector(gain_e_per_dn=2.5, read_noise_e=5.0, offset_dn=40.0)
    assert camera.per_dn == pytest.approx(0.4)
    expected = 60.0 / 2.5 + 4.0 + 1.0 / 12.0
    assert camera.variance_dn(100.0) == pytest.approx(expected)
    assert camera.variance_dn(40.0) == pytest.approx(4.0 + 1.0 / 12.0)


def test_electrons_up_to_a_billion_billion_are_counted():
    camera = lb.Detector(full_well_e=1e4)
    assert camera.expose(np.full(SHAPE, 1e18), 1).min() == 10_000
    with pytest.raises(ValueError, match="at most 1e"):
        camera.expose(np.full(SHAPE, 1.01e18), 1)
    assert camera.expose(np.zeros((0, 4)), 1).shape == (0, 4)


def test_pixels_differ_by_their_response_in_the_same_way_everywhere():
    """A hash of seed and place: neighbours are independent, and so are seeds."""
    wide = (300, 400)
    camera = lb.Detector(prnu=0.1)
    pattern = camera._response_pattern(wide, np.zeros(2))
    assert pattern.mean() == pytest.approx(0.0, abs=0.01)
    assert pattern.std() == pytest.approx(1.0, abs=0.01)
    for down, right in ((0, 1), (1, 0), (1, 1), (0, 2), (7, 3)):
        other = camera._response_pattern(wide, np.array([right, down], float))
        np.testing.assert_array_equal(other[: 300 - down, : 400 - right], pattern[down:, right:])
        assert abs(np.corrcoef(pattern.ravel(), other.ravel())[0, 1]) < 0.02
    seeded = lb.Detector(prnu=0.1, prnu_seed=1)._response_pattern(wide, np.zeros(2))
    assert abs(np.corrcoef(pattern.ravel(), seeded.ravel())[0, 1]) < 0.02
    light = np.full(wide, 1e6)
    response = camera._collected(light, np.zeros(2)) / light
    np.testing.assert_allclose(response, np.maximum(1.0 + 0.1 * pattern, 0.0))
    dark = lb.Detector(prnu=0.5)._collected(light, np.zeros(2))
    assert dark.min() == 0.0


def test_the_hash_of_a_pixel_is_that_of_its_authors():
    """The first numbers of splitmix64 from a state of zero."""
    step = 0x9E3779B97F4A7C15
    states = np.array([(k * step) % 2**64 for k in range(4)], dtype=np.uint64)
    expected = [0xE220A8397B1DCDAF, 0x6E789E6AA1B965F4, 0x06C45D188009454F, 0xF88BB8A8724C81EC]
    assert _splitmix64(states).tolist() == expected
