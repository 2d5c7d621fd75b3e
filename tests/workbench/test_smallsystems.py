"""The two tables of small systems, within the sampling error of 4000 trials."""

import pytest

from losbench.workbench.explorers.lab.smallsystems import METHODS, ring_errors, stacked_errors

RING = {4: (17.7, 13.2, 8.5, 0.985, 0.89), 8: (8.84, 4.37, 0.47, 0.46, 0.44)}
STACKED = {3: (17.0, 7.2, 0.56), 10: (10.0, 3.2, 0.31)}


@pytest.mark.parametrize("spots", RING)
def test_spots_on_a_ring(spots):
    found = ring_errors(spots, seed=spots)
    assert list(found) == list(METHODS)
    assert list(found.values()) == pytest.approx(RING[spots], rel=0.04)


@pytest.mark.parametrize("frames", STACKED)
def test_stacked_frames_of_two_spots(frames):
    found = list(stacked_errors(frames, seed=frames).values())[:3]
    assert found == pytest.approx(STACKED[frames], rel=0.06)


def test_counts_are_checked():
    with pytest.raises(ValueError, match="spots must be a whole number of at least 2, got 1"):
        ring_errors(1)
    with pytest.raises(ValueError, match="frames must be a whole number of at least 1, got 0"):
        stacked_errors(0)
