"""Which windows make which shape, from either side of each number; the shapes themselves are made
up."""

from types import SimpleNamespace

import numpy as np
import pytest

import losbench as lb
from losbench.imaging import shaping
from losbench.imaging.groups import grouped
from losbench.imaging.results import SpotFlag
from losbench.imaging.shaping import _telling, shaped


class Numbered:
    """Windows that are known by their numbers."""

    def __init__(self, numbers):
        self.numbers = np.asarray(numbers)

    def of(self, some):
        return Numbered(self.numbers[some])


def group_of(numbers, window=13):
    return SimpleNamespace(numbers=np.array(numbers), engine=SimpleNamespace(window=window))


@pytest.fixture
def made(monkeypatch):
    """The shapes of groups whose spots have so many windows each, by the windows that made them."""

    def shapes(*groups):
        told = iter([np.repeat(np.arange(len(counts)), counts) for _, counts in groups])

        def telling(group, stack):
            spot = next(told)
            return Numbered(np.arange(len(spot))), spot

        monkeypatch.setattr(shaping, "_telling", telling)
        monkeypatch.setattr(shaping, "fit_shape", lambda windows: windows.numbers.tolist())
        found = shaped(lb.Empirical(), [group for group, _ in groups], np.zeros((1, 9, 9)))
        return found.shape

    monkeypatch.setattr(shaping, "replace", lambda method, shape: SimpleNamespace(shape=shape))
    return shapes


def test_a_spot_with_ten_windows_has_a_shape_of_its_own_and_the_others_share_one(made):
    """The numbers of the call are those of the group, in any order."""
    one, nine, ten = list(range(1)), list(range(1, 10)), list(range(10, 20))
    assert made((group_of([2, 0, 1]), [1, 9, 10])) == (one + nine, ten, one + nine)
    assert made((group_of([0, 1]), [10, 11])) == (list(range(10)), list(range(10, 21)))


def test_nine_windows_together_share_none(made):
    assert made((group_of([0, 1, 2]), [5, 4, 10])) == (None, None, list(range(9, 19)))
    # Those of another size of window are others.
    sizes = (group_of([0], 13), [9]), (group_of([1], 15), [10])
    assert made(*sizes) == (None, list(range(10)))


@pytest.mark.parametrize(("count", "used"), [(28, 252), (29, 256)])
def test_a_shared_shape_is_that_of_256_windows(made, count, used):
    """Of nine of each spot, evenly."""
    (first, *_) = made((group_of(range(count)), [9] * count))
    expected = np.unique(np.linspace(0, 9 * count - 1, 256).astype(int))
    assert first == expected.tolist() and len(first) == used
    (own, *_) = made((group_of([0]), [300]))
    assert len(own) == 300


@pytest.mark.parametrize(("counts", "most"), [([9], 9), ([4, 5], 9), ([0, 0], 0)])
def test_without_ten_windows_of_one_size_there_is_no_shape(made, counts, most):
    with pytest.raises(ValueError, match=f"needs 10 windows of one size .* got {most}:"):
        made((group_of(range(len(counts))), counts))
    with pytest.raises(ValueError, match=f"got {max(most, 3)}:"):
        made((group_of(range(len(counts))), counts), (group_of([len(counts)], 15), [3]))


def test_a_window_is_121_pixels_wide_at_most(made):
    assert made((group_of([0], 121), [10])) == (list(range(10)),)
    with pytest.raises(ValueError, match="at most 121 pixels for a shape of splines, got 123"):
        made((group_of([0], 123), [10]))


# Which windows tell


def frames_of(count, places, seed=3):
    light = lb.render_spots(places, 3e4, 2.0, (60, 90))
    return np.random.default_rng(seed).normal(light + 50.0, 2.0, (count, 60, 90))


def told(stack, places, window=13, method=None):
    at = np.broadcast_to(places, (len(stack), *np.shape(places)))
    method = lb.Empirical() if method is None else method
    (group,) = grouped(stack, at, np.full(len(places), window), method, lb.Ring(), None, None)
    return _telling(group, stack)


@pytest.mark.parametrize(("count", "used"), [(3, 3), (64, 64), (65, 64), (100, 64)])
def test_64_frames_tell_a_shape(count, used):
    stack = frames_of(count, [[30.3, 29.6]])
    windows, spot = told(stack, [[30.0, 30.0]])
    assert spot.tolist() == [0] * used and windows.side == 13
    np.testing.assert_allclose(windows.start, np.tile([0.3, -0.4], (used, 1)), atol=0.02)
    assert (windows.middle == [30, 30]).all() and windows.signal.shape == (used, 15, 15)
    some = np.unique(np.linspace(0, count - 1, used).astype(int))
    for k in (0, -1):
        inner = stack[some[k], 23:38, 23:38]
        np.testing.assert_allclose(windows.signal[k], inner - 50.0, atol=2.0)


def test_spots_that_are_not_found_tell_nothing(monkeypatch):
    stack = frames_of(4, [[30.3, 29.6], [60.2, 30.1]])
    windows, spot = told(stack, [[30.0, 30.0], [75.0, 12.0], [60.0, 30.0], [np.nan, 3.0]])
    assert spot.tolist() == [0] * 4 + [2] * 4
    np.testing.assert_allclose(windows.start[4:], np.tile([0.2, 0.1], (4, 1)), atol=0.02)
    standing = shaping.Measured.nothing

    def nothing(shape):
        found = standing(shape)
        put = found.put

        def lost(where, part):
            part.flags[::2] |= SpotFlag.NOT_CONVERGED
            part.xy[1, 0] = np.nan
            put(where, part)

        object.__setattr__(found, "put", lost)
        return found

    monkeypatch.setattr(shaping.Measured, "nothing", nothing)
    assert len(told(stack, [[30.0, 30.0]])[1]) == 1


@pytest.mark.parametrize(("unread", "tells"), [(25, True), (26, False)])
def test_a_window_tells_where_85_hundredths_of_it_were_read(unread, tells):
    """Of 169 pixels."""
    stack = frames_of(3, [[30.0, 30.0]])
    full = stack[0, 24:37, 24:37]
    order = np.argsort(-full, axis=None)[:unread]
    rows, columns = np.unravel_index(order, full.shape)
    at = np.zeros((3, 1, 2)) + 30.0
    stack[0, 24 + rows, 24 + columns] = 9e3
    given = stack, at, np.array([13]), lb.Empirical(), lb.Ring(), None, 9e3
    (group,) = grouped(*given)
    windows, spot = _telling(group, stack)
    assert len(spot) == (3 if tells else 2) == len(windows.signal)
