"""Records taken apart and put together are those that were."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from losbench.arrays import Bools, Floats
from losbench.records import changed, join, put, stack, take


@dataclass(frozen=True)
class Spots:
    xy: Floats
    good: Bools
    unit: str
    turn: Floats | None = None


def spots(n):
    xy = np.random.default_rng(n).standard_normal((n, 2))
    return Spots(xy, xy[:, 0] > 0, "px")


def same(one, other):
    np.testing.assert_array_equal(one.xy, other.xy)
    np.testing.assert_array_equal(one.good, other.good)
    return one.unit == other.unit and one.turn is other.turn is None


@pytest.mark.parametrize(
    "chosen", [slice(1, 4), [3, 0], np.arange(6) % 2 == 0], ids=["slice", "indices", "bools"]
)
def test_what_is_taken_and_put_back_is_where_it_was(chosen):
    whole = spots(6)
    part = take(whole, chosen)
    np.testing.assert_array_equal(part.xy, whole.xy[chosen])
    emptied = Spots(np.zeros((6, 2)), np.zeros(6, dtype=bool), "px")
    put(emptied, chosen, part)
    np.testing.assert_array_equal(emptied.xy[chosen], whole.xy[chosen])
    left = np.delete(np.arange(6), np.arange(6)[chosen])
    assert not emptied.xy[left].any()


def test_parts_join_to_the_whole():
    whole = spots(6)
    assert same(join([take(whole, slice(0, 2)), take(whole, slice(2, 6))]), whole)
    piled = stack([whole, whole])
    assert piled.xy.shape == (2, 6, 2)
    assert same(take(piled, 1), whole)
    assert same(take(stack([whole, whole], axis=1), 0, axis=1), whole)


def test_only_named_arrays_change():
    whole = spots(6)
    moved = changed(whole, lambda array: array + 1, only=["xy"])
    np.testing.assert_array_equal(moved.xy, whole.xy + 1)
    assert moved.good is whole.good
    target = replace(whole, xy=np.zeros((6, 2)), good=~whole.good)
    put(target, slice(None), whole, only=["xy"])
    np.testing.assert_array_equal(target.xy, whole.xy)
    assert (target.good != whole.good).all()


def test_numbers_without_an_axis_change_too():
    @dataclass(frozen=True)
    class Level:
        dn: np.float64

    assert changed(Level(np.float64(4.0)), np.sqrt).dn == 2.0
