"""Peaks that part or join, crumbs, tiles and the pattern of a sensor, against loops and closed
forms."""

import inspect
from dataclasses import fields

import numpy as np
import pytest
from scipy import ndimage
from scipy.interpolate import RegularGridInterpolator

import losbench as lb
from losbench.imaging.basins import Basins, _keys, _neighbours, group, without_crumbs
from losbench.imaging.levels import _is_flat, _stride, sky_of
from losbench.imaging.mesh import _slopes, _smooth_tiles, _starts, _surface, _to_the_ends, mesh
from losbench.imaging.pattern import FLAT, Pattern, _jump
from losbench.imaging.ranks import level_and_noise, noise_above_black
from losbench.imaging.sky import Sky

# Basins


def pairs(place, width):
    """Places that touch, by sides or corners."""
    at = {divmod(p, width): k for k, p in enumerate(place)}
    steps = ((0, 1), (1, -1), (1, 0), (1, 1))
    return {
        (k, at[row + down, column + right])
        for (row, column), k in at.items()
        for down, right in steps
        if (row + down, column + right) in at
    }


def grouped(place, width, value, noise):
    """The peak of every pixel, one basin at a time."""
    touching = pairs(place, width)
    near = {k: {k} for k in range(len(place))}
    for a, b in touching:
        near[a].add(b)
        near[b].add(a)

    def rank(k):
        return value[k], k

    def root(k, up):
        while up[k] != k:
            k = up[k]
        return k

    up = {k: max(near[k], key=rank) for k in near}
    owner = [root(k, up) for k in range(len(place))]
    while True:
        saddles = {}
        for a, b in touching:
            if owner[a] != owner[b]:
                low, high = sorted((owner[a], owner[b]), key=rank)
                saddles.setdefault(low, []).append((min(value[a], value[b]), high))
        up = {k: k for k in range(len(place))}
        for low, found in saddles.items():
            saddle, high = max(found)
            if saddle >= min(0.8 * value[low], value[low] - 1.5 * noise[low]):
                up[low] = high
        joined = [root(k, up) for k in owner]
        if joined == owner:
            return owner
        owner = joined


@pytest.mark.parametrize("smooth", [0.7, 1.5])
def test_pixels_belong_to_the_peak_that_a_loop_leads_them_to(smooth):
    for seed in range(6):
        rng = np.random.default_rng(seed)
        height = ndimage.gaussian_filter(rng.random((14, 17)), smooth)
        place = np.flatnonzero(rng.random((14, 17)) < 0.7)
        value = 10.0 * height.ravel()[place]
        noise = rng.uniform(0.0, 1.0, len(place))
        ones, others = _neighbours(place, 17)
        assert len(ones) == len(pairs(place, 17))
        assert set(zip(ones.tolist(), others.tolist(), strict=True)) == pairs(place, 17)
        basins, expected = group(place, 17, value, noise), grouped(place, 17, value, noise)
        assert basins.count == len(set(expected))
        np.testing.assert_array_equal(basins.owner, np.unique(expected, return_inverse=True)[1])


@pytest.mark.parametrize("width", [1, 2, 3, 9])
def test_pixels_that_touch_are_those_that_a_loop_finds_in_frames_of_any_width(width):
    for seed in range(6):
        place = np.flatnonzero(np.random.default_rng(seed).random(36) < 0.6)
        ones, others = _neighbours(place, width)
        assert len(ones) == len(pairs(place, width))
        assert set(zip(ones.tolist(), others.tolist(), strict=True)) == pairs(place, width)


def test_keys_tell_apart_what_differs_in_the_eighth_digit_and_hold_their_places():
    value, low = np.array([1.0 + 1e-7, 1.0, 1.0 + 1e-12, 1.0 + 1e-7]), 2**26 - 1
    key = _keys(value, low)
    assert np.argsort(key).tolist() == [1, 2, 0, 3]
    assert (key & low).tolist() == [0, 1, 2, 3]


def test_of_equal_pixels_the_later_is_the_higher():
    for seed in range(6):
        value = np.random.default_rng(seed).integers(0, 9, 60) / 3.0
        for signed in (value, value - 1.5, -value):
            order = np.argsort(_keys(signed, 63))
            np.testing.assert_array_equal(order, np.argsort(signed, kind="stable"))
        place, noise = np.arange(60), np.full(60, 0.1)
        basins, expected = group(place, 10, value, noise), grouped(place, 10, value, noise)
        np.testing.assert_array_equal(basins.owner, np.unique(expected, return_inverse=True)[1])
        ones, others = basins.owner[basins.ones], basins.owner[basins.others]
        assert (ones != others).all() and len(ones) == len(
            [1 for a, b in pairs(place, 10) if basins.owner[a] != basins.owner[b]]
        )


@pytest.mark.parametrize(
    ("saddle", "noise", "spots"),
    [(63.9, 0.0, 2), (64.1, 0.0, 1), (63.9, 10.0, 2), (49.9, 20.0, 2), (50.1, 20.0, 1)],
)
def test_a_dip_is_below_eight_tenths_of_the_fainter_peak_and_surely_below_it(saddle, noise, spots):
    value = np.array([0.0, 100.0, saddle, 80.0, 0.0])
    of_fainter = np.where(value == 80.0, noise, 0.0)
    assert group(np.arange(5), 5, value, of_fainter).count == spots


def two_spots(light, area, apart=1e3, *, touching):
    basins = Basins(
        np.array([0, 1]), 2, *np.array([[0], [1]]) if touching else np.zeros((2, 0), int)
    )
    centre = np.array([[0.0, 0.0], [0.6 * apart, 0.8 * apart]])
    return without_crumbs(basins, np.array(area), np.array([1.0, light]), centre).tolist()


def test_crumbs_touch_a_spot_two_hundred_times_as_bright():
    for light, kept in ((0.0049, False), (0.0051, True)):
        assert two_spots(light, [50.0, 1.0], touching=True) == [True, kept]
    assert two_spots(0.0049, [50.0, 1.0], touching=False) == [True, True]


def test_crumbs_of_a_chain_touch_the_brightest_by_others():
    chain = Basins(np.arange(3), 3, np.array([0, 1]), np.array([1, 2]))
    light, area, centre = np.array([1.0, 0.01, 0.004]), np.ones(3), np.zeros((3, 2))
    assert without_crumbs(chain, area, light, centre).tolist() == [True, True, False]
    apart = Basins(np.arange(3), 3, np.array([1]), np.array([2]))
    assert without_crumbs(apart, area, light, centre).tolist() == [True, True, True]


@pytest.mark.parametrize("area", [200.0, 201.0, 800.0])
def test_wide_spots_have_crumbs_within_a_diameter_and_three_pixels(area):
    reach = 2.0 * np.sqrt(area / np.pi) + 3.0
    for apart, light in ((reach - 0.1, 0.0049), (reach + 0.1, 0.0049), (reach - 0.1, 0.0051)):
        kept = area <= 200 or apart > reach or light > 0.005
        assert two_spots(light, [area, 1.0], apart, touching=False) == [True, kept]


# Tiles


@pytest.mark.parametrize("size", [5, 13, 14, 27, 100])
def test_tiles_cover_every_sample_from_the_first_to_the_last(size):
    starts = _starts(size)
    assert starts[0] == 0 and len(starts) == -(-size // 13)
    assert starts[-1] == max(size - 13, 0)
    assert (np.diff(starts) <= 13).all()


def test_halves_of_a_tile_tell_its_slope():
    y, x = np.mgrid[:13, :13]
    tiles = (7.0 + 0.3 * y - 0.2 * x)[None, None]
    np.testing.assert_allclose(_slopes(tiles)[0, 0], [0.3, -0.2], atol=1e-12)
    tiles[0, 0, 4:6, 4:6] = 1e3  # a spot
    np.testing.assert_allclose(_slopes(tiles)[0, 0], [0.3, -0.2], atol=0.03)


def test_a_surface_is_the_quadratic_through_all_tiles_but_the_brightest_fifth():
    y, x = np.meshgrid(np.linspace(-1, 1, 6), np.linspace(-1, 1, 7), indexing="ij")
    level = 50.0 + 3 * y - 2 * x + 4 * y**2 + 5 * x**2 - 1.5 * x * y
    noise = np.full(level.shape, 0.1)
    np.testing.assert_allclose(_surface(level, noise), level, atol=1e-9)
    raised = level.copy()
    raised[2:4, 3:6] += 40.0
    np.testing.assert_allclose(_surface(raised, noise), level, atol=1e-9)
    for shape in ((1, 1), (1, 5), (3, 2), (3, 3)):
        plane = np.add.outer(2.0 * np.arange(shape[0]), 3.0 * np.arange(shape[1]))
        fitted = _surface(plane, np.full(shape, 0.1))
        assert fitted.shape == shape
        if min(shape) > 1:
            np.testing.assert_allclose(fitted, plane, atol=1e-9)


def test_tiles_within_three_errors_of_the_surface_stay():
    """The error of a level is told by 1.5 noises over the root of the 169 samples of a tile."""
    level, noise = np.zeros((7, 7)), np.full((7, 7), 2.0)
    allowed = 3 * 1.5 * 2.0 / 13
    for height, ignored in ((0.95 * allowed, False), (1.05 * allowed, True)):
        lifted = level.copy()
        lifted[3, 3] = height  # among the brightest fifth, so that it must come back
        assert (np.abs(_surface(lifted, noise)).max() < 1e-9) == ignored


def tiles_with(object_noises, where):
    level, noise = np.zeros((9, 9)), np.full((9, 9), 2.0)
    level[where] = 2.0 * object_noises
    return _smooth_tiles(level, noise)


def test_one_raised_tile_is_a_spot_and_two_of_eight_noises_a_big_object():
    one, noise = tiles_with(20.0, np.s_[4, 4])
    np.testing.assert_allclose(one, 0.0, atol=1e-9)
    np.testing.assert_allclose(noise, 2.0)
    for height, gone in ((7.5, False), (8.5, True)):
        level, _ = tiles_with(height, np.s_[3:6, 3:6])
        assert (np.abs(level).max() < 1e-9) == gone, height
    level = np.zeros((9, 9))
    level[3:6, 3:6], level[4, 4] = 6.0, 20.0  # three noises, and one tile of ten: no object
    smooth, _ = _smooth_tiles(level, np.full((9, 9), 2.0))
    assert np.abs(smooth).max() > 5.0
    level[4, 5] = 20.0
    smooth, _ = _smooth_tiles(level, np.full((9, 9), 2.0))
    np.testing.assert_allclose(smooth, 0.0, atol=1e-9)


def test_the_noise_under_a_big_object_is_that_beside_it():
    level, noise = np.zeros((9, 9)), np.full((9, 9), 2.0)
    level[3:6, 3:6], noise[2:7, 2:7] = 1000.0, 30.0
    np.testing.assert_allclose(_smooth_tiles(level, noise)[1], 2.0)


def test_tiles_go_straight_on_to_the_ends():
    middle = np.array([10.0, 20.0, 32.0])
    tiles = (5.0 + 2.0 * middle)[:, None] * np.array([1.0, -1.0])
    carried = _to_the_ends(tiles, middle, 51, 0)
    at = np.array([0.0, *middle, 50.0])
    np.testing.assert_allclose(carried, (5.0 + 2.0 * at)[:, None] * [1.0, -1.0])
    one = _to_the_ends(np.array([[3.0, 4.0]]), np.array([7.0]), 15, 0)
    np.testing.assert_array_equal(one, [[3.0, 4.0]] * 3)


@pytest.mark.parametrize(("side", "step"), [(255, 3), (256, 5)])
def test_tiles_are_of_every_fifth_pixel_or_third_of_a_small_frame(side, step):
    y, x = np.mgrid[:side, : side + 40]
    noise = np.random.default_rng(1).normal(0.0, 3.0, y.shape)
    sky = mesh(200.0 + 0.5 * x + 0.2 * y + noise, 0.0, 3.0, 0.1)
    starts = _starts(-(-side // step))
    np.testing.assert_allclose(sky.row[1:-1], step * (starts + 6.0))
    assert sky.row[0] == 0.0 and sky.row[-1] == side - 1.0 and sky.column[-1] == side + 39.0
    level, spread = sky.at(y.ravel(), x.ravel())
    np.testing.assert_allclose(level, (200.0 + 0.5 * x + 0.2 * y).ravel(), atol=2.5)
    np.testing.assert_allclose(spread, 3.0, rtol=0.25)


# Sky


def a_sky(pattern=FLAT):
    rng = np.random.default_rng(2)
    row, column = np.array([0.0, 5.0, 14.0, 19.0]), np.array([0.0, 8.0, 29.0])
    return Sky(rng.random((4, 3)), 1 + rng.random((4, 3)), row, column, pattern)


PATTERN = Pattern(np.array([[1.0, -2.0], [3.0, -2.0]]), np.array([7.0, -4.0]), (10.0, 15.0))


def test_between_the_middles_of_tiles_the_sky_is_straight():
    sky = a_sky(PATTERN)
    y, x = np.mgrid[:20, :30]
    at = np.stack([y.ravel(), x.ravel()], axis=-1)
    level, noise = (
        RegularGridInterpolator((sky.row, sky.column), values)(at)
        for values in (sky.level, sky.noise)
    )
    added = PATTERN.phase[y % 2, x % 2] + 7.0 * (y >= 10) - 4.0 * (x >= 15)
    found = sky.at(y.ravel(), x.ravel())
    np.testing.assert_allclose(found[0], level + added.ravel(), atol=1e-12)
    np.testing.assert_allclose(found[1], noise, atol=1e-12)
    cut = sky.cut(5.0, 0, 20, 30)
    np.testing.assert_allclose(cut, (level + 5 * noise).reshape(20, 30) + added, atol=1e-5)
    np.testing.assert_array_equal(sky.cut(5.0, 7, 12, 30), cut[7:12])
    plain = Pattern(np.zeros((2, 2)), np.zeros(2), (10.0, 15.0))
    np.testing.assert_allclose(
        a_sky(plain).cut(5.0, 0, 20, 30), (level + 5 * noise).reshape(20, 30), atol=1e-5
    )
    for only in (
        Pattern(PATTERN.phase, np.zeros(2), (10.0, 15.0)),
        Pattern(np.zeros((2, 2)), PATTERN.tap, (10.0, 15.0)),
    ):
        expected = (level + 5 * noise).reshape(20, 30) + only.at(y, x)
        np.testing.assert_allclose(a_sky(only).cut(5.0, 0, 20, 30), expected, atol=1e-5)


def test_a_flat_sky_is_one_level_and_one_noise():
    sky = a_sky()
    assert sky.flat and not a_sky(PATTERN).flat
    level, noise = sky.at(np.array([3, 4]), np.array([5, 6]))
    np.testing.assert_array_equal(level, sky.level[0, 0])
    np.testing.assert_array_equal(noise, sky.noise[0, 0])


# The pattern of a sensor


def test_a_pattern_is_found_on_a_slope():
    y, x = np.mgrid[:120, :150]
    phase = np.array([[1.0, -2.0], [3.0, -2.0]])
    frame = 50 + 0.03 * y - 0.02 * x + phase[y % 2, x % 2] + 7.0 * (y >= 60) - 4.0 * (x >= 75)
    found = Pattern.of(frame[::3, ::3], 3, frame.shape, 0.1)
    np.testing.assert_allclose(found.phase, phase, atol=1e-9)
    np.testing.assert_allclose(found.tap, [7.0, -4.0], atol=1e-9)
    assert found.middle == (60.0, 75.0)


def test_the_phases_of_a_pattern_add_up_to_nothing():
    """Of noise that is skewed, whose medians do not."""
    noise = np.random.default_rng(4).exponential(1.0, (60, 80))
    y, x = np.mgrid[:60, :80]
    found = Pattern.of(noise + 3.0 * (y % 2) + 1.0 * (x % 2), 1, noise.shape, 0.5)
    assert found.phase.sum() == pytest.approx(0.0, abs=1e-12) and np.ptp(found.phase) > 3.0


def test_a_pattern_below_the_least_is_none():
    y, x = np.mgrid[:40, :50]
    phase = 0.5 * np.where((y + x) % 2, 1.0, -1.0)
    for least, told in ((0.99, True), (1.01, False)):
        assert Pattern.of(phase, 1, phase.shape, least).phase.any() == told
    tap = 3.0 * (y >= 20)
    for least, told in ((1.49, True), (1.51, False)):
        found = Pattern.of(tap, 1, tap.shape, least).tap
        np.testing.assert_allclose(found, [3.0 * told, 0.0], atol=1e-12)


@pytest.mark.parametrize("shape", [(101, 3), (3, 101), (4, 3)])
def test_too_few_samples_to_hold_every_phase_tell_no_phase(shape):
    y, x = np.mgrid[: shape[0], : shape[1]]
    assert not Pattern.of(9.0 * ((y + x) % 2), 1, shape, 0.1).phase.any()
    assert Pattern.of(9.0 * ((np.mgrid[:4, :4].sum(0)) % 2), 1, (4, 4), 0.1).phase.any()


@pytest.mark.parametrize("turned", [False, True])
def test_a_strip_of_nine_rows_under_a_slope_is_searched(turned):
    frame = np.random.default_rng(1).normal(np.linspace(0.0, 200.0, 303)[:, None], 2.0, (303, 9))
    frame[150, 4] += 300.0
    frame[149:152, 3:6] += 100.0
    found = lb.find_spots(frame.T if turned else frame)
    np.testing.assert_allclose(found, [[150.0, 4.0] if turned else [4.0, 150.0]], atol=0.2)


def test_a_jump_needs_eight_samples_on_either_side_and_one_sign_in_both_halves():
    def jump(first, last, left=2.0, right=2.0):
        y = np.arange(first + last)[:, None]
        step = np.where(np.arange(20) < 9, left, right)
        return _jump(0.25 * y + step * (y >= first), float(first), 9.0)

    assert jump(8, 8) == pytest.approx(2.0)
    assert jump(7, 9) == jump(9, 7) == 0.0
    assert jump(10, 10, left=1.0) == pytest.approx(1.0)
    assert jump(10, 10, right=-0.5) == 0.0
    assert jump(10, 10, left=-0.4, right=-0.3) == pytest.approx(-0.3)
    assert jump(10, 10, left=0.0) == 0.0


# One level, or many


@pytest.mark.parametrize(("spread", "flat"), [(0.45, True), (0.55, False)])
def test_a_sky_is_flat_where_medians_differ_by_less_than_half_its_noise(spread, flat):
    """Of cells so large that the scatter of their medians is less than that."""
    sample = np.zeros((120, 120))
    sample[:60] = spread * 3.0
    cells = sample.reshape(4, 30, 4, 30).swapaxes(1, 2).reshape(16, -1)
    assert _is_flat(cells, sample, 3.0, 0.0) == flat
    checked = np.where(np.add.outer(np.arange(120), np.arange(120)) % 2, spread * 3.0, 0.0)
    assert _is_flat(np.zeros((16, 900)), checked, 3.0, 0.0) == flat


@pytest.mark.parametrize(("share", "flat"), [(0.97, True), (1.03, False)])
def test_medians_of_few_samples_may_differ_by_five_of_their_errors(share, flat):
    """6.25 noises over the root of their number: five times 1.25, the error of a median."""
    cells = np.zeros((16, 36))
    cells[0] = share * 6.25 * 3.0 / 6.0
    assert _is_flat(cells, np.zeros((24, 24)), 3.0, 0.0) == flat
    sample = np.where(np.add.outer(np.arange(12), np.arange(12)) % 2, share * 6.25 * 3.0 / 6.0, 0.0)
    assert _is_flat(np.zeros((16, 9)), sample, 3.0, 0.0) == flat


def test_whole_numbers_may_differ_by_a_step():
    cells = np.zeros((16, 900))
    cells[0] = 0.14 + 1.0
    assert _is_flat(cells, np.zeros((120, 120)), 0.29, 1.0)
    cells[0] = 0.15 + 1.0
    assert not _is_flat(cells, np.zeros((120, 120)), 0.29, 1.0)


def test_stamps_have_one_level_and_frames_of_a_slope_many():
    for shape, flat in (((32, 32), True), ((33, 32), False)):
        frame = np.add.outer(np.zeros(shape[0]), 50.0 * np.arange(shape[1]))
        frame += np.random.default_rng(3).normal(0.0, 1.0, shape)
        assert sky_of(frame, float(frame.max()), 8.0).flat == flat


@pytest.mark.parametrize(("size", "step"), [(4600, 1), (4700, 5), (51_000, 5), (62_000, 7)])
def test_some_two_thousand_pixels_are_looked_at_in_all_phases(size, step):
    assert _stride(size) == step
    for wanted in range(1, 60):
        found = _stride(2048 * wanted**2)
        assert found % 2 and found % 3 and wanted <= found <= wanted + 3


@pytest.mark.parametrize(("shape", "most"), [((32, 32), 0.5), ((40, 45), 0.75)])
def test_spots_may_fill_half_of_a_stamp_and_a_quarter_of_a_frame(shape, most):
    """Only the ranks below tell level and noise."""
    values = np.random.default_rng(5).normal(20.0, 3.0, shape)
    order = np.argsort(values, axis=None)

    def told(rank=None):
        moved = values.copy()
        if rank is not None:
            moved.ravel()[order[int(rank * moved.size)]] += 1e-3
        sky = sky_of(moved, 40.0, 8.0)
        assert sky.flat
        return sky.level[0, 0], sky.noise[0, 0]

    for rank, counts in ((0.04, False), (0.06, True), (most - 0.02, True), (most + 0.02, False)):
        assert (told(rank) != told()) == counts, rank


def test_each_row_of_samples_is_told_as_if_it_were_alone():
    """A row that is clipped beside one that is hardly, and one with few ranks beside one with
    many."""
    rng = np.random.default_rng(6)
    rows = rng.normal([[0.3], [1.6], [20.0]], 1.0, (3, 400)).clip(0.0)
    black = rows <= 0.0
    assert black.mean(axis=1)[1] < 0.08 < black.mean(axis=1)[0]
    together = level_and_noise(rows, 0.0, black)
    alone = [
        level_and_noise(row[None], 0.0, dark[None]) for row, dark in zip(rows, black, strict=True)
    ]
    np.testing.assert_allclose(np.array(together), np.concatenate(alone, axis=1), rtol=1e-12)
    np.testing.assert_allclose(together[0], [0.3, 1.6, 20.0], atol=0.25)


def test_noise_that_falls_towards_the_border_stays_half_of_the_least():
    x = np.arange(300)
    rising = np.maximum(1.0, (x - 60.0) / 2.0)
    frame = np.random.default_rng(7).standard_normal((300, 300)) * rising + 1000.0
    sky = mesh(frame, 0.0, 1.0, 0.1)
    least = sky.noise[1:-1, 1:-1].min()
    assert sky.noise[:, 0].min() == pytest.approx(0.5 * least)


@pytest.mark.parametrize(("saddle", "spots"), [(12.0, 2), (13.0, 1)])
def test_dips_and_noise_are_compared_after_a_mean_of_nine_pixels(monkeypatch, saddle, spots):
    """The fainter peak of 20 and a noise of 5 leave 12.5."""
    ends = np.array([0.0, 1.0])
    dark = Sky(np.zeros((2, 2)), np.full((2, 2), 5.0), ends, ends, FLAT)
    monkeypatch.setattr("losbench.imaging.finder.sky_of", lambda *_: dark)
    profile = np.repeat([0.0, 30.0, saddle, 20.0, 0.0], [9, 3, 3, 3, 12])
    frame = np.zeros((40, 30))
    frame[15:26] = profile
    assert len(lb.find_spots(frame, threshold=1.0)) == spots


def test_the_call_and_the_choice_have_the_same_defaults():
    words = inspect.signature(lb.find_spots).parameters
    for field in fields(lb.Find):
        assert words[field.name].default == field.default


@pytest.mark.parametrize(("pixels", "crowded"), [(1224, False), (1236, True)])
def test_a_frame_is_crowded_where_six_tenths_of_it_are_bright(monkeypatch, pixels, crowded):
    """Of 2050 pixels; a stamp of 1024 may be filled by one spot."""
    ends = np.array([0.0, 1.0])
    dark = Sky(np.zeros((2, 2)), np.ones((2, 2)), ends, ends, FLAT)
    monkeypatch.setattr("losbench.imaging.finder.sky_of", lambda *_: dark)
    frame = np.zeros((41, 50))
    frame.ravel()[:pixels] = 20.0
    if crowded:
        with pytest.raises(ValueError, match=f"{pixels} of 2050 pixels stand out at threshold 8"):
            lb.find_spots(frame)
    else:
        assert len(lb.find_spots(frame)) == 1
    assert len(lb.find_spots(np.full((32, 32), 20.0))) == 1
    with pytest.raises(ValueError, match="1056 of 1056 pixels"):
        lb.find_spots(np.full((33, 32), 20.0))


@pytest.mark.parametrize(("share", "clips"), [(0.075, False), (0.085, True)])
def test_black_is_clipped_from_eight_hundredths_on(share, clips):
    values = np.sort(np.random.default_rng(9).normal(10.0, 2.0, (1, 2000)))
    dark = np.arange(2000)[None] < share * 2000
    values[dark] = values[dark].max()
    plain = level_and_noise(values, 0.0, np.zeros_like(dark))
    found = level_and_noise(values, 0.0, dark)
    assert (found[1] != plain[1]).all() == clips
    ring = values.copy()
    assert (noise_above_black(ring) > 0).all() == clips


def test_jumps_are_looked_for_without_the_phases(monkeypatch):
    asked = []

    def jump(sample, middle, across):
        asked.append((sample, middle, across))
        return 0.0

    monkeypatch.setattr("losbench.imaging.pattern._jump", jump)
    y, x = np.mgrid[:60, :80]
    noise = np.random.default_rng(4).normal(50.0, 0.1, (60, 80))
    Pattern.of(noise + 30.0 * (y % 2) - 20.0 * (x % 2), 3, (180, 240), 0.5)
    (rows, *of_rows), (columns, *of_columns) = asked
    assert (of_rows, of_columns) == ([30.0, 40.0], [40.0, 30.0])
    assert np.ptp(rows) < 2.0 and rows.mean() == pytest.approx(55.0, abs=0.1)
    np.testing.assert_array_equal(columns, rows.T)
