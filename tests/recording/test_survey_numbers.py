"""Lost spots, bands of rows, clipped black and the reference, from either side of their numbers."""

from types import SimpleNamespace

import numpy as np
import pytest

import losbench as lb
from losbench.recording import acquire
from losbench.recording.acquire import Known, elsewhere, found_again, strangers
from losbench.recording.bands import Bands
from losbench.recording.nodes import median_light
from losbench.recording.survey import _clipped_black
from losbench.recording.track import Track

NOTHING = np.zeros((0, 2))


def finds(monkeypatch, *places):
    """Let the finder see these."""
    at = np.array(places, float).reshape(-1, 2)
    monkeypatch.setattr(acquire, "_FIND", SimpleNamespace(find=lambda image: at))


def known(start, sides=13, others=NOTHING, flux=np.nan):
    count = len(start)
    return Known(
        np.array(start, float), np.broadcast_to(sides, count), np.full(count, flux), others
    )


def test_what_is_not_a_spot_stays_or_moves_with_them():
    start = np.array([[10.0, 10.0], [30.0, 10.0], [50.0, 10.0]])
    places = start + np.array([[4.0, 2.0], [np.nan, np.nan], [6.0, 4.0]])
    found = known(start, others=np.array([[70.0, 20.0]])).others(places)
    np.testing.assert_allclose(found, [[70.0, 20.0], [75.0, 23.0]])


@pytest.mark.parametrize(("away", "near"), [(6.5, True), (6.6, False)])
def test_a_find_within_half_a_window_is_the_spot_itself(monkeypatch, away, near):
    places = np.array([[20.0, 20.0], [60.0, 20.0]])
    finds(monkeypatch, [20.0 + away, 20.0], [60.0, 20.0 - away - 5.0], [40.0, 60.0])
    found = strangers(None, places, np.array([13, 23]))
    expected = [[40.0, 60.0]] if near else [[26.6, 20.0], [60.0, 8.4], [40.0, 60.0]]
    np.testing.assert_allclose(found, expected)


def test_the_200_brightest_finds_are_looked_at(monkeypatch):
    finds(monkeypatch, *np.stack([np.arange(205.0), np.zeros(205)], axis=-1))
    found = strangers(None, np.array([[500.0, 500.0]]), np.array([13]))
    assert found[:, 0].tolist() == list(range(200))


def test_one_lost_spot_may_be_any_find_that_no_other_claims(monkeypatch):
    start = np.array([[20.0, 20.0], [60.0, 20.0]])
    finds(monkeypatch, [60.0, 26.0], [100.0, 50.0], [90.0, 40.0], [22.0, 21.0])
    lost = np.array([True, False])
    given = known(start, others=np.array([[96.0, 50.0]]))
    options = found_again(None, start, lost, given)
    assert [option[0].tolist() for option in options] == [[90.0, 40.0], [22.0, 21.0]]
    assert all(np.isnan(option[1]).all() for option in options)
    wide = known(start, sides=np.array([45, 13]), others=np.array([[96.0, 50.0]]))
    # Around what is no spot the widest window counts.
    assert [option[0].tolist() for option in found_again(None, start, lost, wide)] == [[22.0, 21.0]]


@pytest.mark.parametrize(("off", "met"), [(2.9, 2), (3.1, 0)])
def test_spots_have_moved_alike_within_three_pixels(monkeypatch, off, met):
    start = np.array([[20.0, 20.0], [60.0, 20.0]])
    finds(monkeypatch, [30.0, 45.0], [70.0 + off, 45.0])
    found = found_again(None, start, np.array([True, True]), known(start))
    if met:
        np.testing.assert_allclose(found[0], [[30.0, 45.0], [72.9, 45.0]])
    else:
        assert found == []


def test_a_spot_that_has_not_moved_with_the_others_stays_lost(monkeypatch):
    start = np.array([[20.0, 20.0], [60.0, 20.0], [20.0, 90.0]])
    finds(monkeypatch, [30.0, 45.0], [70.0, 45.0])
    (found,) = found_again(None, start, np.array([True] * 3), known(start))
    np.testing.assert_allclose(found[:2], start[:2] + np.array([10.0, 25.0]))
    assert np.isnan(found[2]).all()


@pytest.mark.parametrize(("apart", "told"), [(5.0, True), (7.0, False)])
def test_two_shifts_that_fit_as_well_tell_nothing_unless_they_are_one(monkeypatch, apart, told):
    start = np.array([[20.0, 20.0], [60.0, 20.0]])
    shifts = np.array([[10.0, 45.0], [10.0 + apart, 45.0]])
    finds(monkeypatch, *[place + shift for shift in shifts for place in start])
    assert bool(found_again(None, start, np.array([True, True]), known(start))) == told


@pytest.mark.parametrize(
    ("flux", "flag", "met"),
    [
        (1.0, 0, 1),
        (2.1, 0, 0),
        (0.49, 0, 0),
        (1.0, int(lb.SpotFlag.NOT_CONVERGED), 0),
        (1.0, int(lb.SpotFlag.RING), 1),
    ],
)
def test_a_lost_spot_has_come_to_rest_with_the_light_that_it_had(monkeypatch, flux, flag, met):
    start = np.array([[20.0, 20.0], [60.0, 20.0]])
    finds(monkeypatch, [90.0, 20.0])

    def see(frames, option):
        return SimpleNamespace(
            xy=option[None].copy(), flags=np.array([[flag, 0]]), flux=np.array([[flux, np.nan]])
        )

    lost = np.array([True, False])
    found = elsewhere([None], start, lost, known(start, flux=1.0), see)
    assert (found is not None) == bool(met)
    finds(monkeypatch, [90.0, 20.0], [20.0, 80.0])  # two of the same light
    assert elsewhere([None], start, lost, known(start, flux=1.0), see) is None


# The survey


def test_the_light_of_a_spot_is_the_median_of_the_frames_that_show_it():
    flux = np.array([[1.0, np.nan, np.nan], [4.0, np.nan, 7.0], [2.0, np.nan, np.nan]])
    found = median_light(flux)
    np.testing.assert_array_equal(found, [2.0, np.nan, 7.0])


@pytest.mark.parametrize(
    ("lowest", "above", "share"),
    [(8, 7, 0.08), (7, 6, 0.0), (9, 9, 0.0), (9, 10, 0.0), (30, 20, 0.3)],
)
def test_black_is_clipped_from_eight_hundredths_and_more_than_the_next(lowest, above, share):
    rest = 10.0 + np.arange(100 - lowest - above)
    stack = np.concatenate([np.zeros(lowest), np.ones(above), rest, [np.nan] * 7])
    assert _clipped_black(np.random.default_rng(1).permutation(stack)) == pytest.approx(share)


def test_readings_that_are_all_the_same_or_none_are_not_clipped():
    assert _clipped_black(np.full(50, 3.0)) == 0.0 == _clipped_black(np.full(50, np.nan))


# Bands


@pytest.mark.parametrize(
    ("window", "side", "reach"),
    [(13, None, 3 + 13 + 6 + 8), (7, None, 2 + 7 + 3 + 8), (13, 25, 3 + 13 + 12 + 8)],
)
def test_a_band_reaches_as_far_as_windows_and_rings_can_come(window, side, reach):
    places = np.array([[[20.0, 200.4]], [[20.0, 203.2]]])
    (span,) = Bands.around(places, window, side, 1000).spans
    assert span == (200 - reach, 204 + reach + 1)


def test_bands_hold_six_tenths_of_the_rows_at_most():
    """Of 102 rows 61, and not of 101."""
    places = np.array([[[20.0, 50.0]]])
    (span,) = Bands.around(places, 13, None, 102).spans
    assert span == (20, 81)
    assert Bands.around(places, 13, None, 101).spans is None


def test_bands_that_touch_are_one():
    reach = 30
    for apart, count in ((2 * reach + 1, 1), (2 * reach + 2, 2)):
        places = np.array([[[20.0, 200.0], [20.0, 200.0 + apart]]])
        bands = Bands.around(places, 13, None, 1000)
        assert len(bands.spans) == count
        whole = np.arange(1000)
        rows = np.concatenate([whole[slice(*span)] for span in bands.spans])
        assert rows[bands.within(places[0])[:, 1].astype(int)].tolist() == [200, 200 + apart]


# Tracks and the reference


@pytest.mark.parametrize("reach", [1.5, 2.5])
def test_each_spot_has_a_reach_of_its_own(reach):
    places = np.zeros((2, 2, 2))
    xy = places.copy()
    xy[1, 1, 0] = 2.0
    track = Track(xy, xy, np.zeros((2, 2), int))
    assert track.near(places, np.array([1.5, reach])).tolist() == [True, reach > 2.0]


@pytest.mark.parametrize(("reference", "fits"), [(1, True), (3, True), (0, False), (4, False)])
def test_a_reference_is_of_one_frame_up_to_all(reference, fits):
    frame = lb.render_spots([[20.0, 15.0]], 5e4, 2.0, (32, 48)).round().astype(np.uint16)
    recording = lb.read_recording(np.stack([frame] * 3))
    how = {"centroid": lb.EIWA(9), "spots": [[20.0, 15.0]], "reference": reference}
    if fits:
        assert lb.measure(recording, **how).shifts_px.shape == (3, 1, 2)
    else:
        with pytest.raises(ValueError, match="reference must be a whole number from 1 to 3"):
            lb.measure(recording, **how)
