"""From widths to windows, number by number; the widths themselves are made up."""

import numpy as np
import pytest

from losbench.imaging import sizes
from losbench.imaging.sizes import _unlike, _widened, default_window, spot_sigma, window_in_first

FRAME = np.zeros((200, 300))


@pytest.fixture
def windows(monkeypatch):
    """Windows of spots that have these widths at these places."""

    def found(sigma, places, frame=FRAME):
        monkeypatch.setattr(sizes, "spot_sigma", lambda *_: np.array(sigma, float))
        return default_window(frame, np.array(places, float)).tolist()

    return found


def row_of(count, apart=60.0, at=(50.0, 100.0)):
    return [(at[0] + k * apart, at[1]) for k in range(count)]


@pytest.mark.parametrize(
    ("sigma", "side"),
    [(0.3, 3), (0.5, 3), (0.549, 3), (0.551, 5), (1.0, 7), (2.2, 13), (2.21, 13), (2.23, 15)],
)
def test_a_window_is_the_first_odd_one_from_three_tenths_below_six_sigma(windows, sigma, side):
    assert windows([sigma], [(150.0, 100.0)]) == [side]


def test_spots_that_no_image_shows_have_three_pixels(windows):
    assert windows([np.nan] * 2, row_of(2)) == [3, 3]
    assert windows([np.nan, 2.0, 2.0], row_of(3)) == [13, 13, 13]


@pytest.mark.parametrize("side", ["left", "right", "top", "bottom"])
@pytest.mark.parametrize(
    ("away", "window"), [(10.0, 21), (9.8, 19), (9.51, 19), (9.49, 19), (8.9, 17), (0.2, 3)]
)
def test_a_window_is_the_largest_that_fits_around_the_spot(windows, side, away, window):
    place = {
        "left": (away, 100.0),
        "right": (299.0 - away, 100.0),
        "top": (150.0, away),
        "bottom": (150.0, 199.0 - away),
    }[side]
    assert windows([30.0], [place]) == [window]


def test_the_largest_window_is_that_of_the_frame_where_a_spot_has_most_room(windows):
    frames = np.zeros((4, 200, 300))
    places = [[(4.0, 100.0)], [(20.0, 100.0)], [(12.0, 100.0)], [(np.nan, np.nan)]]
    assert windows([30.0], places, frames) == [41]
    assert windows([30.0], [[(np.nan, np.nan)]] * 4, frames) == [3]
    # One that is like the others may reach beyond the frame, where theirs does not.
    assert windows([5.0, 5.0], [(4.0, 100.0), (150.0, 100.0)]) == [31, 31]
    assert windows([2.0, 2.0, 9.0], [(80.0, 100.0), (200.0, 100.0), (10.0, 100.0)]) == [13, 13, 21]


@pytest.mark.parametrize(
    ("common", "own", "has"),
    [
        *((13, 15, 13), (13, 17, 17), (13, 11, 13), (13, 9, 9), (21, 23, 21), (21, 25, 25)),
        *((61, 67, 61), (61, 69, 69), (61, 55, 61), (61, 53, 53)),
    ],
)
def test_windows_within_two_pixels_or_a_tenth_of_the_median_s_are_one(windows, common, own, has):
    sigma = [common / 6.0] * 3 + [own / 6.0]
    assert windows(sigma, row_of(4, 70.0)) == [common] * 3 + [has]


@pytest.mark.parametrize(
    ("own", "apart", "near"),
    [
        ((31, 13), 12.9, True),
        ((31, 13), 13.1, False),
        ((31, 41), 30.9, True),
        ((31, 41), 31.1, False),
    ],
)
def test_a_spot_is_widened_by_one_within_the_smaller_of_both_windows(own, apart, near):
    """Wider than is common, and by another than itself; in both directions of the larger step."""
    own = np.array([*own, 31])
    for step in ((apart, 0.0), (0.0, -apart), (-apart, 0.9 * apart)):
        at = np.array([(0.0, 0.0), step, (500.0, 0.0)])
        assert _widened(at, own, np.array([0, 2]), 13).tolist() == [near, False]
        assert _widened(at, own, np.array([0, 2]), 31).tolist() == [False, False]
        assert _widened(at, own, np.array([0, 2]), 30).tolist() == [near, False]


def test_a_spot_that_stands_in_another_s_window_has_the_common_one(windows):
    far = row_of(3, at=(50.0, 150.0))
    for apart, window in ((12.0, 13), (14.0, 37)):
        places = [*far, (50.0, 50.0), (50.0 + apart, 50.0)]
        assert windows([2.0, 2.0, 2.0, 6.0, 2.0], places)[3] == window
    # One that is not seen has three pixels.
    for apart, window in ((2.9, 13), (3.1, 37)):
        places = [*far, (50.0, 50.0), (50.0 + apart, 50.0)]
        assert windows([2.0, 2.0, 2.0, 6.0, np.nan], places)[3] == window
    # Where they are in the first frame that shows them.
    places = np.tile([*far, (50.0, 50.0), (150.0, 50.0)], (3, 1, 1))
    places[0, 3] = np.nan
    places[2, 4] = 52.0, 50.0
    assert windows([2.0, 2.0, 2.0, 6.0, 2.0], places, np.zeros((3, 200, 300)))[3] == 37
    places[1, 3] = 150.0, 52.0
    assert windows([2.0, 2.0, 2.0, 6.0, 2.0], places, np.zeros((3, 200, 300)))[3] == 13


@pytest.mark.parametrize(("shape", "most"), [((20, 30), 19), ((21, 30), 21), ((30, 20), 19)])
def test_the_window_of_a_recording_fits_into_its_frames(monkeypatch, shape, most):
    monkeypatch.setattr(sizes, "default_window", lambda *_: np.array([7, most, 41]))
    assert window_in_first(np.zeros(shape), np.zeros((3, 2))).tolist() == [7, most, most]


# Which spots are sized, and in which frames


@pytest.fixture
def sized(monkeypatch):
    """Numbers of the spots that are looked at, by their x, and how many frames are."""
    asked = []

    def aperture_sigma(stack, frame, middle):
        asked.append((int(middle[0, 0]), frame.tolist()))
        return 2.0 + 0.01 * len(asked)

    monkeypatch.setattr(sizes, "aperture_sigma", aperture_sigma)
    return asked


@pytest.mark.parametrize(("n", "looked"), [(1, 1), (16, 16), (17, 16), (40, 16)])
def test_a_width_is_that_of_sixteen_frames(sized, n, looked):
    spot_sigma(np.zeros((n, 30, 40)), [[20.0, 15.0]])
    ((_, frames),) = sized
    assert frames == np.unique(np.linspace(0, n - 1, looked).astype(int)).tolist()


@pytest.mark.parametrize(("count", "looked"), [(15, 15), (16, 16), (17, 16), (30, 16)])
def test_sixteen_spots_are_sized_and_the_others_have_their_median(
    monkeypatch, sized, count, looked
):
    unlike = []

    def others(image, places, sigma):
        unlike.append(sigma)
        return np.array([1, 2])

    monkeypatch.setattr(sizes, "_unlike", others)
    found = spot_sigma(np.zeros((30, 400)), [(10.0 * k + 5.0, 15.0) for k in range(count)])
    first = np.unique(np.linspace(0, count - 1, looked).astype(int))
    again = np.setdiff1d([1, 2], first)
    assert [(x - 5) // 10 for x, _ in sized] == [*first, *(again if count > 16 else [])]
    median = np.median(2.0 + 0.01 * np.arange(1, looked + 1))
    assert unlike == ([pytest.approx(median)] if count > 16 else [])
    rest = np.setdiff1d(np.arange(count), [*first, *again])
    np.testing.assert_allclose(found[rest], median)


def test_where_none_of_sixteen_is_seen_no_other_is_asked_for(monkeypatch):
    monkeypatch.setattr(sizes, "aperture_sigma", lambda *_: np.nan)
    places = [(10.0 * k + 5.0, 15.0) for k in range(20)]
    assert np.isnan(spot_sigma(np.zeros((30, 400)), places)).all()
    assert np.isnan(spot_sigma(np.zeros((30, 40)), [[-9.0, 5.0]])).all()


# Which look unlike the others


def image_of(cores, apart=60, level=0.0, height=100.0):
    """Spots of so many pixels, those nearest to each of the places."""
    y, x = np.mgrid[-10:11, -10:11]
    order = np.argsort(np.hypot(x, y) + 1e-6 * np.arctan2(y, x), axis=None)
    image = np.full((60, apart * len(cores) + 20), level)
    for k, core in enumerate(cores):
        part = np.zeros(21 * 21)
        part[order[:core]] = height
        image[20:41, k * apart + 20 : k * apart + 41] += part.reshape(21, 21)
    return image, np.array([(30.0 + k * apart, 30.0) for k in range(len(cores))])


@pytest.mark.parametrize("level", [0.0, 500.0, -80.0])
@pytest.mark.parametrize("sigma", [2.0, 2.5])
def test_a_spot_is_unlike_with_twice_as_many_pixels_above_half_of_its_peak_or_half_as_many(
    level, sigma
):
    """2 pi ln 2 sigma^2, and three more or fewer."""
    expected = 2.0 * np.pi * np.log(2.0) * sigma**2
    most, fewest = int(2.0 * expected + 3.0), int(np.ceil(expected / 2.0 - 3.0))
    cores = [fewest - 1, fewest, round(expected), most, most + 1]
    assert _unlike(*image_of(cores, level=level), sigma).tolist() == [0, 4]


def test_pixels_of_a_spot_are_above_half_of_the_highest_of_the_nine_in_its_middle():
    image, places = image_of([17, 17, 17, 17])
    y, x = np.mgrid[25:36, 25:36]
    around = np.hypot(x - 30, y - 30) > 3.0
    image[25:36, 25:36][around] = 51.0  # all 121 are above half
    image[25:36, 85:96][around] = 49.0
    image[30, 152] = 1e4  # beyond the nine: not the peak
    image[29, 211] = 1e4  # one of them, which leaves one pixel
    assert _unlike(image, places, 2.0).tolist() == [0, 3]


@pytest.mark.parametrize(("apart", "alone"), [(12, False), (13, True)])
def test_a_spot_that_has_another_within_six_sigma_is_not_looked_at(apart, alone):
    image, places = image_of([1])
    for step in ((apart, 0), (0, apart), (apart, apart - 1)):
        both = np.concatenate([places, places + step])
        assert (0 in _unlike(image, both, 2.0)) == alone


@pytest.mark.parametrize(("sigma", "core", "reach"), [(2.0, 12, 7), (2.1, 12, 8), (3.0, 30, 10)])
def test_the_level_is_the_median_of_the_rim_of_a_stamp_of_three_sigma_and_a_pixel(
    sigma, core, reach
):
    """Where that is as bright as the spot, nothing stands out of it."""
    y, x = np.mgrid[-30:30, -30:50]
    away = np.maximum(abs(x), abs(y))
    for bright, height, unlike in (
        (away == reach, 100.0, True),
        (away == reach + 1, 100.0, False),
        ((away == reach) & (abs(y) < reach), 49.0, False),  # less than half of it
        ((away == reach) & ((abs(y) == reach) | (x > 0)), 100.0, True),
    ):
        image, places = image_of([core])
        image[bright] = height
        assert (_unlike(image, places, sigma).tolist() == [0]) == unlike
