"""Layouts of spots: known optima, random ones that do not come near, and breakdown in a
millisecond.
"""

from dataclasses import replace

import numpy as np
import pytest

import losbench as lb
from losbench.pointing.attitude import layout as room

CAMERA = lb.Camera(focal_mm=260.0, pixel_um=10.0, shape=(1080, 1920))
ENDS = np.array([[20.0, 20.0], [1899.0, 1059.0]])


def rows_of(layout):
    return lb.design_matrix(CAMERA.points_mm(layout))


def layouts(count, rng):
    """Random, clustered, on a line, one far away, two clumps: spots (n, 2) in pixels."""
    middle = ENDS.mean(axis=0)
    for k in range(count):
        n = int(rng.integers(2, 13))
        kind = k % 5
        xy = rng.uniform(*ENDS, (n, 2))
        if kind == 1:
            xy = middle + rng.normal(0, 60, (n, 2))
        elif kind == 2:
            xy = ENDS[0] + rng.uniform(0, 1, (n, 1)) * (ENDS[1] - ENDS[0])
        elif kind == 3:
            xy = middle + rng.normal(0, 40, (n, 2))
            xy[0] = ENDS[1]
        elif kind == 4:
            xy = np.where(np.arange(n)[:, None] % 2, ENDS[0], ENDS[1]) + rng.normal(0, 15, (n, 2))
        yield xy


def test_the_fast_count_of_bad_spots_is_that_of_the_search():
    for xy in layouts(40, np.random.default_rng(5)):
        found = lb.design_breakdown(rows_of(xy), group=np.repeat(np.arange(len(xy)), 2))
        assert lb.bad_spots_survived(CAMERA.points_mm(xy)) == found.monotone
        shares = room.largest_shares(rows_of(xy))
        assert np.all(shares <= found.shares + 1e-9)
        assert np.all(shares >= found.shares - 0.02)


def test_shares_of_many_layouts_are_those_of_each():
    rng = np.random.default_rng(2)
    rows = rows_of(rng.uniform(*ENDS, (5, 6, 2)))
    together = room.largest_shares(rows, directions=200)
    alone = [room.largest_shares(each, directions=200) for each in rows]
    assert np.allclose(together, alone, rtol=1e-12)


def test_two_spots_lie_in_opposite_corners():
    found = lb.design_layout(2, CAMERA, 0.02)
    assert np.ptp(found.xy_px, axis=0).tolist() == [1879.0, 1039.0]
    # Roll of two spots on a baseline b: sigma sqrt(2) / b.
    baseline = np.hypot(1879.0, 1039.0)
    roll = lb.units.rad_to_arcsec(0.02 * np.sqrt(2.0) / baseline)
    assert found.sigma_arcsec[2] == pytest.approx(roll, rel=2e-3)
    assert found.survives == 0
    assert not found.meets


def test_four_spots_lie_in_the_four_corners():
    found = lb.design_layout(4, CAMERA, 0.02)
    corners = {(x, y) for x in (20.0, 1899.0) for y in (20.0, 1059.0)}
    assert set(map(tuple, found.xy_px.tolist())) == corners
    assert found.survives == 1


@pytest.mark.parametrize(("n", "survives"), [(3, 0), (6, 1), (8, 2)])
def test_a_thousand_random_layouts_are_no_better(n, survives):
    found = lb.design_layout(n, CAMERA, 0.02, survives=survives)
    assert found.survives >= survives
    rng = np.random.default_rng(11)
    random = np.stack([room.random_layout(n, ENDS, 40.0, rng) for _ in range(1000)])
    worst = room._errors_arcsec(found, rows_of(random)).max(axis=-1)
    shares = room.largest_shares(rows_of(random), directions=400)
    allowed = shares[:, survives] < 0.5
    assert allowed.sum() > 5
    assert found.worst < worst[allowed].min()


def test_errors_are_those_of_the_covariance():
    found = lb.design_layout(5, CAMERA, 0.05, wanted_arcsec=(0.2, 0.2, 5.0), stack=4)
    expected = lb.attitude_covariance(
        CAMERA.points_mm(found.xy_px), 0.05 * CAMERA.pixel_mm, stack=4
    )
    assert found.sigma_arcsec == pytest.approx(
        lb.units.rad_to_arcsec(np.sqrt(np.diag(expected))), rel=1e-9
    )
    assert found.meets
    assert found.worst == pytest.approx(np.max(found.sigma_arcsec / (0.2, 0.2, 5.0)))


def test_what_is_wanted_changes_the_places():
    roll = lb.design_layout(6, CAMERA, 0.02, survives=0)
    robust = lb.design_layout(6, CAMERA, 0.02, survives=2)
    assert robust.worst > roll.worst
    gaps = np.linalg.norm(roll.xy_px[:, None] - roll.xy_px, axis=-1)[np.triu_indices(6, 1)]
    assert gaps.min() >= 40.0 - 1e-9


def test_more_than_can_be_survived_is_not_met_and_says_so():
    found = lb.design_layout(4, CAMERA, 0.02, wanted_arcsec=100.0, survives=3)
    assert found.survives < 3
    assert not found.meets


def test_the_map_is_lowest_where_the_spot_lies_and_is_drawn():
    from matplotlib.figure import Figure

    found = lb.design_layout(4, CAMERA, 0.02)
    x, y = np.meshgrid(np.linspace(20, 1899, 9), np.linspace(20, 1059, 9))
    assert found.map(0, found.xy_px[0]) == pytest.approx(found.worst)
    assert found.map(0, np.stack([x, y], axis=-1)).min() >= found.worst - 1e-9
    figure = Figure()
    found.draw(figure.subplots())
    assert len(figure.axes[0].collections) >= 1


def test_bad_input_is_one_line():
    for arguments, words in (
        ({"n": 1}, "n must be"),
        ({"margin_px": 600.0}, "margin_px leaves no room"),
        ({"n": 12, "apart_px": 1500.0}, "apart_px leaves no room for 12 spots"),
        ({"survives": 8}, "survives must be"),
        ({"sigma_px": 0.0}, "sigma_px must be"),
    ):
        given = {"n": 8, "sigma_px": 0.02, **arguments}
        with pytest.raises(ValueError, match=words):
            lb.design_layout(given.pop("n"), CAMERA, given.pop("sigma_px"), **given)


def test_the_sensor_is_drawn_whole_with_every_spot_and_the_chosen_one():
    from matplotlib.figure import Figure

    found = lb.design_layout(4, CAMERA, 0.02, survives=1)
    axes = Figure().subplots()
    found.draw(axes, spot=2)
    high, wide = CAMERA.shape
    assert axes.get_xlim() == (0, wide - 1)
    assert axes.get_ylim() == (high - 1, 0)
    every, chosen = axes.get_lines()
    np.testing.assert_array_equal(np.transpose(every.get_data()), found.xy_px)
    np.testing.assert_array_equal(np.ravel(chosen.get_data()), found.xy_px[2])
    lines, closed = axes.collections
    assert lines.levels[0] == pytest.approx(1.01 * found.worst)
    assert (np.diff(lines.levels) > 0).all()
    assert closed.levels[0] == pytest.approx(0.5, abs=1e-6)


def test_a_layout_moved_by_one_spot_has_the_errors_of_the_map():
    found = lb.design_layout(3, CAMERA, 0.02, wanted_arcsec=(0.1, 0.2, 3.0), stack=2)
    places = np.array([[500.0, 300.0], [900.0, 700.0]])
    for place, worst in zip(places, found.map(1, places), strict=True):
        moved = found.xy_px.copy()
        moved[1] = place
        cov = lb.attitude_covariance(CAMERA.points_mm(moved), 0.02 * CAMERA.pixel_mm, stack=2)
        errors = lb.units.rad_to_arcsec(np.sqrt(np.diag(cov))) / (0.1, 0.2, 3.0)
        assert worst == pytest.approx(errors.max(), rel=1e-9)
    assert found.map(1, found.xy_px[0]) == np.inf or found.map(1, found.xy_px[0]) > found.worst


def test_a_layout_that_leaves_a_rotation_open_has_no_error():
    found = lb.design_layout(2, CAMERA, 0.02)
    assert found.map(0, found.xy_px[1]) == np.inf


@pytest.mark.parametrize(("limit", "meets"), [(1.001, True), (0.999, False)])
def test_what_is_wanted_is_met_up_to_its_limit(limit, meets):
    found = lb.design_layout(3, CAMERA, 0.02)
    wanted = np.full(3, limit * found.worst)
    assert replace(found, wanted_arcsec=wanted).meets == meets
    assert not replace(found, wanted_arcsec=wanted, wanted_survives=1).meets


def test_directions_cover_half_a_sphere_evenly():
    sphere = room._half_sphere.__wrapped__(400)
    np.testing.assert_allclose(np.linalg.norm(sphere, axis=1), 1.0)
    assert (sphere[:, 2] > 0).all()
    # Heights in equal steps, and each a golden share of a turn from the one before.
    np.testing.assert_allclose(np.diff(sphere[:, 2]), 1.0 / 400, rtol=1e-9)
    turn = np.diff(np.arctan2(sphere[:, 1], sphere[:, 0])) / (2.0 * np.pi) % 1.0
    np.testing.assert_allclose(turn, 2.0 / (1.0 + np.sqrt(5.0)), rtol=1e-9)
    anywhere = np.random.default_rng(12).standard_normal((4000, 3))
    anywhere /= np.linalg.norm(anywhere, axis=1, keepdims=True)
    nearest = np.abs(anywhere @ sphere.T).max(axis=1)
    assert np.degrees(np.arccos(nearest)).max() < 6.5  # a 400th of it is 4 degrees in radius


def test_starts_fill_the_sensor_and_keep_their_distance():
    ends = np.array([[20.0, 20.0], [1899.0, 1059.0]])
    ring, *others = room._starts(4, ends, 300.0, np.random.default_rng(1))
    middle = ends.mean(axis=0)
    np.testing.assert_allclose(ring.mean(axis=0), middle, atol=1e-9)
    np.testing.assert_allclose(np.hypot(*((ring - middle) / (ends[1] - middle)).T), 1.0, rtol=1e-12)
    turn = np.sort(np.arctan2(*((ring - middle) / (ends[1] - middle)).T[::-1]))
    np.testing.assert_allclose(np.diff(turn), np.pi / 2)
    for layout in others:
        gaps = np.linalg.norm(layout[:, None] - layout, axis=-1)[np.triu_indices(4, 1)]
        assert gaps.min() >= 300.0
        assert (layout >= ends[0]).all() and (layout <= ends[1]).all()


def test_room_for_one_place_each_is_room():
    """A sensor no larger than its margins has one place, and one spot alone fits there."""
    tight = lb.Camera(focal_mm=260.0, pixel_um=10.0, shape=(41, 1920))
    found = lb.design_layout(2, tight, 0.02)
    assert found.xy_px[:, 1].tolist() == [20.0, 20.0]
    with pytest.raises(ValueError, match="margin_px leaves no room on 1920 x 40 px"):
        lb.design_layout(2, replace(tight, shape=(40, 1920)), 0.02)


def test_an_arcsecond_for_each_angle_is_wanted_unless_said():
    found = lb.design_layout(2, CAMERA, 0.02)
    assert found.wanted_arcsec.tolist() == [1.0, 1.0, 1.0]
    assert (found.wanted_survives, found.stack, found.model) == (0, 1, "pinhole")


def test_a_map_is_drawn_over_the_whole_sensor(monkeypatch):
    from matplotlib.figure import Figure

    found, asked = lb.design_layout(4, CAMERA, 0.02), []
    mapped = room.SpotLayout.map
    monkeypatch.setattr(
        room.SpotLayout, "map", lambda task, k, xy: asked.append((k, xy)) or mapped(task, k, xy)
    )
    found.draw(Figure().subplots(), spot=1)
    ((spot, places),) = asked
    assert spot == 1
    assert places.min(axis=(0, 1)).tolist() == [0.0, 0.0]
    assert places.max(axis=(0, 1)).tolist() == [1919.0, 1079.0]


def test_spots_may_be_asked_to_be_apart_by_less_than_a_pixel():
    assert lb.design_layout(2, CAMERA, 0.02, apart_px=0.5).xy_px.shape == (2, 2)


# The search, with costs made by hand

FIELD = np.array([[0.0, 0.0], [1400.0, 700.0]])


def searched(cost, start, monkeypatch, apart=0.0):
    """Layout that the search ends with, its cost, and all layouts (m, n, 2) it looked at, call by
    call.
    """
    looked = []

    def costs(task, layouts):
        looked.append(layouts.copy())
        return [(0.0, float(cost(layout))) for layout in layouts]

    monkeypatch.setattr(room, "_costs", costs)
    layout, (_, found) = room._exchanged(None, np.array(start, dtype=float), FIELD, apart)
    return layout, found, looked


def test_a_spot_is_tried_on_fifteen_by_as_fine_a_grid_and_then_nearer_and_nearer(monkeypatch):
    target = np.array([[333.0, 222.0], [0.0, 0.0]])
    layout, _, looked = searched(
        lambda xy: np.abs(xy - target).sum(), [[1.0, 1.0], [0.0, 0.0]], monkeypatch
    )
    first = looked[1][:, 0]  # of spot 0, the other stays
    assert sorted(set(first[:, 0])) == pytest.approx(np.linspace(0, 1400, 15))
    assert sorted(set(first[:, 1])) == pytest.approx(np.linspace(0, 700, 8))
    assert len(first) == 15 * 8
    assert (looked[1][:, 1] == 0.0).all()
    assert np.abs(layout - target).max() <= 100.0 / 16 / 2 + 1e-9
    steps = [np.ptp(some[:, 0], axis=0) for some in looked[1:] if len(some) == 9]
    sizes = {step[0] for step in steps} - {0.0}  # of spot 0, and none while the other moves
    assert sizes == {100.0, 50.0, 25.0, 12.5}  # twice the step, to both sides
    assert all(step[0] == step[1] for step in steps)


def test_the_search_goes_on_until_no_spot_moves(monkeypatch):
    """Two spots that want to lie close together and far to the right: neither can go alone."""

    def cost(xy):
        apart, far = xy[0] - xy[1], xy.sum(axis=0) - [2000.0, 777.0]
        return 6.0 * apart @ apart + far @ far

    layout, found, _ = searched(cost, [[20.0, 20.0], [130.0, 20.0]], monkeypatch)
    step = 100.0 / 16
    for spot in (0, 1):
        for move in ([step, 0.0], [-step, 0.0], [0.0, step], [0.0, -step]):
            other = layout.copy()
            other[spot] = np.clip(other[spot] + move, *FIELD)
            assert cost(other) >= found
    assert found == cost(layout) < cost(np.array([[20.0, 20.0], [130.0, 20.0]]))


def test_spots_keep_their_distance_and_the_margin_while_they_are_moved(monkeypatch):
    layout, _, looked = searched(
        lambda xy: -xy.sum(), [[0.0, 0.0], [700.0, 0.0]], monkeypatch, apart=100.0
    )
    for some in looked:
        assert (some >= FIELD[0]).all() and (some <= FIELD[1]).all()
        assert np.linalg.norm(some[:, 0] - some[:, 1], axis=-1).min() >= 100.0
    assert sorted(layout.tolist()) == [[1300.0, 700.0], [1400.0, 700.0]] or sorted(
        layout.tolist()
    ) == [[1400.0, 600.0], [1400.0, 700.0]]
    far = searched(lambda xy: -xy.sum(), [[0.0, 0.0], [1400.0, 0.0]], monkeypatch, apart=2e3)[0]
    np.testing.assert_array_equal(far, [[0.0, 0.0], [1400.0, 0.0]])  # no place is far enough


def test_more_bad_spots_than_wanted_weigh_before_any_error():
    found = lb.design_layout(4, CAMERA, 0.02, survives=1)
    inside = np.array([[900.0, 500.0], [1000.0, 500.0], [900.0, 600.0], [20.0, 20.0]])
    (none, worst), (much, _) = room._costs(found, np.stack([found.xy_px, inside]))
    assert worst == pytest.approx(found.worst)
    share = room.largest_shares(rows_of(inside), directions=200)[1]
    assert none == 0.0 and much == pytest.approx(share - 0.49)
    assert room._costs(replace(found, wanted_survives=0), inside[None])[0][0] == 0.0


@pytest.mark.parametrize(("apart", "open_"), [(1e-2, False), (2e-3, False), (1e-6, True)])
def test_spots_a_thousandth_of_a_pixel_apart_still_tell_a_rotation(apart, open_):
    found = lb.design_layout(2, CAMERA, 0.02)
    place = found.xy_px[1] + [apart, 0.0]
    if open_:
        assert found.map(0, place) == np.inf
        return
    moved = np.stack([place, found.xy_px[1]])
    cov = lb.attitude_covariance(CAMERA.points_mm(moved), 0.02 * CAMERA.pixel_mm)
    errors = lb.units.rad_to_arcsec(np.sqrt(np.diag(cov)))
    assert found.map(0, place) == pytest.approx(errors.max(), rel=0.05)
