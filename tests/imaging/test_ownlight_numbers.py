"""Light of another spot, taken off along lines from the centre, number by number."""

import numpy as np
import pytest

from losbench.imaging.ownlight import without_hot, without_others

MIDDLE = np.array([30.0, 30.0])


def profile(*parts, size=61):
    """Light that depends on the column alone: from so many pixels right of the middle on so much,
    and on the left only that of the three beside the middle.
    """
    line = np.zeros(size)
    for first, value in parts:
        line[size // 2 + first :] = value
    line[size // 2 - 3 : size // 2] = parts[0][1]
    return np.tile(line, (size, 1))


def taken(light, right, *, least=50.0, noise=0.0):
    """Whether that pixel of the middle row has lost its light to the other side."""
    found = without_others(light, MIDDLE, least, noise)
    place = 30, 30 + right
    assert found[place] in (light[place], pytest.approx(light[30, 30 - right], abs=1e-4))
    return found[place] != light[place]


def test_what_lies_before_a_dip_is_the_spot_s_own():
    light = profile((0, 200.0), (5, 100.0), (13, 20.0), (18, 100.0))
    assert [taken(light, right) for right in (6, 9, 12, 18, 22, 30)] == [False] * 3 + [True] * 3


@pytest.mark.parametrize(
    ("dip", "told"), [(5, False), (6, True), (7, False), (8, False), (9, True), (15, True)]
)
def test_nine_places_from_a_fifth_of_the_way_on_are_looked_at(dip, told):
    """Of 30 pixels each third, from the sixth on: a dip of one pixel there is seen."""
    assert taken(profile((0, 200.0), (1, 100.0), (dip, 20.0), (dip + 1, 100.0)), 30) == told


@pytest.mark.parametrize("noise", [0.0, 4.0])
def test_light_beyond_a_dip_is_a_quarter_brighter_by_five_noises(noise):
    for over, told in ((-1.0, False), (1.0, True)):
        top = 60.0 / 0.8 + 5.0 * noise + over
        assert taken(profile((0, 200.0), (6, 60.0), (18, top)), 24, noise=noise) == told


def test_a_dip_below_the_level_is_as_deep_as_one_to_the_level():
    for over, told in ((-1.0, False), (1.0, True)):
        for dip in (0.0, -40.0):
            light = profile((0, 200.0), (6, dip), (18, 5.0 * 12.0 + over))
            assert taken(light, 24, least=10.0, noise=12.0) == told


@pytest.mark.parametrize(("other", "told"), [(49.0, True), (51.0, False)])
def test_light_is_brighter_than_that_on_the_other_side_by_the_least(other, told):
    light = profile((0, 200.0), (6, 10.0), (18, 100.0))
    light[:, :13] = other
    assert taken(light, 24) == told


@pytest.mark.parametrize("turns", [0, 1, 2, 3])
def test_the_centre_may_stand_anywhere(turns):
    light = profile((0, 200.0), (6, 10.0), (18, 100.0))[:, 4:]
    light[:3] = 0.0
    height, width = light.shape
    x, y = 26.0, 30.0
    for _ in range(turns):
        light, (x, y) = np.rot90(light), (y, light.shape[1] - 1 - x)
    found = without_others(np.ascontiguousarray(light), np.array([x, y]), 50.0, 0.0)
    back = np.rot90(found, -turns)
    assert back.shape == (height, width)
    assert (back[28:33, 44:50] == 0.0).all() and (back[28:33, 26:30] == 200.0).all()


def test_a_hot_pixel_shares_its_light_with_none_of_the_four_that_touch_it():
    for row in (-1, 0, 1):
        for column in (-1, 0, 1):
            touches = abs(row) + abs(column) == 1
            for light in (290.0, 310.0):
                image = np.zeros((9, 9), np.float32)
                image[4, 4] = 1000.0
                image[4 + row, 4 + column] += light
                hot = without_hot(image, 3.0)[4, 4] == 0.0
                assert hot == (light < 300.0 or not touches)
