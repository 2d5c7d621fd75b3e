"""Which frames are compared, against a search through all of them."""

import numpy as np
import pytest

from losbench.imaging.pairs import Pairing, nearest_pairs


def by_search(places, most):
    """Of each spot every frame with the nearest other one, each pair once, the closest first."""
    found = []
    for spot in range(places.shape[1]):
        at = places[:, spot]
        gaps = np.linalg.norm(at[:, None] - at, axis=-1)
        np.fill_diagonal(gaps, np.nan)
        seen = np.isfinite(at).all(axis=1)
        if seen.sum() < 2:
            continue
        pairs = {tuple(sorted((k, int(np.nanargmin(gaps[k]))))) for k in np.flatnonzero(seen)}
        found += [(spot, *pair) for pair in sorted(pairs, key=lambda pair: gaps[pair])[:most]]
    return found


def listed(pairing):
    return [
        (s, *pair) for s, pair in zip(pairing.spot.tolist(), pairing.frames.tolist(), strict=True)
    ]


@pytest.mark.parametrize("most", [1, 3, 100])
@pytest.mark.parametrize("size", [30.0, 1e3])
def test_the_closest_frames_of_each_spot_are_compared(most, size):
    places = size * np.random.default_rng(7).random((25, 4, 2)) * [1.0, 3.0]
    places += 0.1 * size * np.arange(4)[:, None]  # spots so near that they lie among each other
    places[[3, 4], 1, [0, 1]] = np.nan  # one coordinate is enough
    places[2:, 2] = np.nan  # in two frames
    places[1:, 3] = np.nan  # in one
    places[:, :, 0] = np.where(np.isnan(places[:, :, 1]), 0.0, places[:, :, 0])
    assert listed(nearest_pairs(places, most)) == by_search(places, most)


def test_spots_above_each_other_are_no_pair():
    places = np.zeros((2, 5, 2)) + np.array([0.0, 40.0])[:, None, None]
    assert listed(nearest_pairs(places, 9)) == [(k, 0, 1) for k in range(5)]


def test_where_no_spot_is_seen_twice_there_are_no_pairs():
    for places in (np.full((4, 2, 2), np.nan), np.zeros((1, 3, 2)), np.zeros((4, 0, 2))):
        found = nearest_pairs(places, 5)
        assert found.spot.shape == (0,) and found.frames.shape == (0, 2)
        assert found.shared.shape == (0,)


def test_a_millipixel_parts_the_frames_of_a_spot_that_rests():
    """So that no frame is in all pairs; what moves by more is not touched by it."""
    found = nearest_pairs(np.tile([[[5.0, 7.0]]], (200, 2, 1)), 1000)
    assert np.bincount(found.spot).min() > 60
    for spot in (0, 1):
        assert np.bincount(found.frames[found.spot == spot].ravel()).max() <= 6
    places = np.zeros((200, 1, 2))
    places[:, 0, 0] = np.repeat(np.arange(100), 2) * 0.01
    places[1::2, 0, 0] += 0.003
    pairs = [pair[1:] for pair in listed(nearest_pairs(places, 1000))]
    assert sorted(pairs) == [(2 * k, 2 * k + 1) for k in range(100)]


@pytest.mark.parametrize("seed", range(3))
def test_pairs_that_share_frames_are_counted_for_each_spot(seed):
    """1 + a quarter of the mean number of others that a pair shares a frame with."""
    rng = np.random.default_rng(seed)
    spot = np.sort(rng.integers(0, 4, 30)) * 2  # numbers without pairs between them
    frames = np.array([rng.choice(6, 2, replace=False) for _ in spot])
    found = Pairing.of_frames(spot, frames)
    for k in np.unique(spot):
        own = frames[spot == k]
        sharing = [
            sum(len({*a} & {*b}) for j, b in enumerate(own) if j != i) for i, a in enumerate(own)
        ]
        np.testing.assert_allclose(found.shared[spot == k], 1.0 + np.mean(sharing) / 4.0)
    some = found.of(slice(3, 9))
    assert listed(some) == listed(found)[3:9]
    np.testing.assert_array_equal(some.shared, found.shared[3:9])
