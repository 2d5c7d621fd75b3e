"""Folds left out: leave-one-out in closed form, steps that no fold can tell, choices that recover."""

import numpy as np
import pytest

import losbench as lb
from losbench.pointing.thermal.choose import _Search
from losbench.pointing.thermal.folds import read_folds, sigma_about_zero
from losbench.pointing.thermal.terms import Fourier, Lagged, Linear, Offset, Steps, Trend

RNG = np.random.default_rng(20261812)
T = 3600.0 * np.arange(600)
ROOM, OTHER = np.sin(T / 80_000.0) + 0.1 * RNG.standard_normal(600), RNG.standard_normal(600)
SENSORS = {"room": ROOM, "other": OTHER}
Y = 1e-6 * ROOM + 5e-8 * RNG.standard_normal(600)


def test_leaving_out_one_sample_each_is_the_press_of_least_squares():
    n = 40
    found = lb.cross_validate(
        Offset() + Linear("room"), Y[:n], {"room": ROOM[:n]}, T[:n], folds=n, solver="ls"
    )
    columns = np.column_stack([np.ones(n), ROOM[:n]])
    hat = columns @ np.linalg.pinv(columns)
    press = (Y[:n] - hat @ Y[:n]) / (1 - np.diag(hat))
    np.testing.assert_allclose(found.errors, press, rtol=1e-8)
    assert found.sigma == pytest.approx(1.482602218505602 * np.median(np.abs(press)))


def test_an_offset_between_folds_is_an_error_and_a_median_by_fold_shows_it():
    fold = np.arange(600) // 150
    y = Y + 3e-6 * (fold == 2)
    found = lb.cross_validate(Offset() + Linear("room"), y, SENSORS, T, folds=fold)
    assert found.median_by_fold[2] == pytest.approx(3e-6, rel=0.05)
    assert found.by_fold[2] > 3e-6
    assert found.labels.tolist() == ["0", "1", "2", "3"]


def test_forward_predicts_from_the_past_alone_and_baselines_stand_beside():
    y = Y + 1e-11 * T * 0.5
    found = lb.cross_validate(
        Offset() + Linear("room") + Trend(1), y, SENSORS, T, folds=6, horizon="forward"
    )
    assert found.not_predictable == ("block 1",)
    assert np.isnan(found.errors[:100]).all()
    assert set(found.baselines) == {"constant", "trend", "last", "1 d"}
    # The difference of two samples holds twice the noise of one, the model's error once.
    assert found.baselines["last"] > 1.2 * found.sigma


def test_a_step_inside_a_fold_left_out_cannot_be_predicted():
    fold = np.arange(600) // 100
    model = Offset() + Linear("room") + Steps((T[599],))
    assert lb.cross_validate(model, Y, SENSORS, T, folds=fold).not_predictable == ("5",)
    inside = Offset() + Steps((T[210], T[290]))
    found = lb.cross_validate(inside, Y, SENSORS, T, folds=fold)
    assert found.not_predictable == ("2",)
    assert np.isnan(found.errors[200:300]).all()


def test_years_are_julian_from_the_first_sample():
    year = 31_557_600.0
    number, labels = read_folds("year", np.array([5.0, 6.0, 5.0 + year, 5.0 + 2.5 * year]))
    assert number.tolist() == [0, 0, 1, 2]
    assert labels == ["year 1", "year 2", "year 3"]


def test_sigma_is_about_zero():
    assert sigma_about_zero(np.full((5, 1), -2.0))[0] == pytest.approx(2 * 1.482602218505602)
    assert np.isnan(sigma_about_zero(np.full((3, 1), np.nan))[0])


def test_a_choice_takes_what_is_there_and_nothing_else():
    room_late = lb.terms.Lagged("room", tau_s=40_000.0)
    y = 1e-6 * lb.terms.Lagged("room", tau_s=40_000.0).columns(SENSORS, T)[:, 0]
    y = y + 3e-7 * np.cos(2 * np.pi * T / 86_400.0) + 5e-8 * RNG.standard_normal(600)
    y[::50] += 1e-4
    candidates = {
        "room": Linear("room"),
        "room late": room_late,
        "other": Linear("other"),
        "daily": Fourier(86_400.0),
        "trend": Trend(1),
    }
    found = lb.choose(candidates, y, SENSORS, T, folds=5)
    assert [name for name, _ in found.path] == ["start", "room late", "daily"]
    assert found.picked["daily"] == 5
    assert found.picked["other"] == 0
    assert found.nested_sigma == pytest.approx(5e-8, rel=0.2)
    assert found.model.labels[0] == "offset"
    # The last sigma is that of the same model under plain cross-validation.
    again = lb.cross_validate(found.model, y, SENSORS, T, folds=5)
    assert again.sigma == pytest.approx(found.path[-1][1], rel=1e-6)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: lb.cross_validate(Offset(), Y, {}, T, folds=np.zeros(600)),
            "folds must be at least two, got 1",
        ),
        (lambda: lb.cross_validate(Offset(), Y, {}, T, folds=1), "folds must be a whole number"),
        (
            lambda: lb.cross_validate(Offset(), Y, {}, T, folds="month"),
            "folds must be one of 'year'",
        ),
        (
            lambda: lb.cross_validate(Offset(), np.where(T[300] > T, np.nan, Y), {}, T, folds=4),
            "folds must each hold samples, got none in block 1",
        ),
        (
            lambda: lb.choose({"a": Lagged("room")}, Y, SENSORS, T),
            "candidates must have known lags, got one to fit in a",
        ),
        *(
            (
                lambda call=call: call(np.where((T[100] <= T) & (T[250] > T), np.nan, Y), folds=6),
                "folds must each hold samples, got none in block 2",
            )
            for call in (
                lambda y, **o: lb.cross_validate(Offset(), y, {}, T, **o),
                lambda y, **o: lb.choose({"trend": Trend(1)}, y, {}, T, **o),
            )
        ),
        (
            lambda: lb.choose({"trend": Trend(1)}, Y * np.nan, {}, T),
            "folds must each hold samples, got none in block 1",
        ),
        (
            lambda: lb.cross_validate(Offset(), Y, {}, T, folds=np.where(T[9] < T, 1.0, np.nan)),
            "folds must name every sample's fold, got 10 NaN",
        ),
        (
            lambda: lb.cross_validate(Offset(), Y, {}, T, folds=np.zeros(599)),
            r"folds must have shape \(600,\) to match time_s",
        ),
        (
            lambda: lb.cross_validate(Offset() + Steps((9e9,)), Y, {}, T),
            "Steps must lie within the record",
        ),
        (
            lambda: lb.choose({"step": Steps((-1.0,))}, Y, {}, T),
            "Steps must lie within the record",
        ),
        (lambda: lb.choose({"t": Trend(1)}, np.ones((600, 2)), {}, T), "angles must be one axis"),
        (lambda: lb.choose({"t": Trend(1)}, Y, {}, T, folds=2), "folds must be at least three"),
    ],
)
def test_bad_input_to_a_cross_validation_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


# Steps of the choice


def search_of(columns, y, folds, *, solver=None, least_gain=0.02, at_most=8):
    n = len(y)
    solver = lb.IRLS() if solver is None else solver
    return _Search(columns, y, np.arange(n) * folds // n, solver, least_gain, at_most)


@pytest.mark.parametrize("apart", [1.0, 1e-4, 3e-6])
@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_candidates_are_ranked_by_weighted_least_squares_beside_the_model(apart, unit):
    """Under the weights of the model alone; of two columns a candidate may need the difference."""
    rng = np.random.default_rng(1)
    one, two, other = rng.standard_normal((3, 90))
    columns = {
        "start": np.column_stack([np.ones(90), 3.0 + rng.standard_normal(90)]),
        "pair": unit * np.column_stack([one, one + apart * two]),
        "other": other[:, None],
    }
    y = two + 0.1 * rng.standard_t(2, 90)
    search = search_of(columns, y, 3)
    kept = frozenset({0, 2})
    rows = np.isin(search.fold, [0, 2])
    weights = lb.irls(columns["start"][rows], y[rows]).weights
    assert (weights < 1.0).any()
    root = np.sqrt(weights)[:, None]
    for name in ("pair", "other"):
        both = np.column_stack([columns["start"], columns[name]])
        size = np.linalg.norm(both[rows] * root, axis=0)
        x = np.linalg.lstsq(both[rows] * root / size, y[rows] * root[:, 0])[0] / size
        ours = np.concatenate(search._beside(("start",), kept)[name])
        np.testing.assert_allclose(both @ ours, both @ x, atol=1e-3)
    ranked = search._ranked(["start"], [0, 1, 2])
    assert list(ranked) == ["pair", "other"] and ranked["pair"] < ranked["other"]
    errors = np.full(90, np.nan)
    for fold in (0, 1, 2):
        test = search.fold == fold
        x, gain = search._beside(("start",), frozenset({0, 1, 2}) - {fold})["other"]
        errors[test] = y[test] - columns["start"][test] @ x - columns["other"][test] @ gain
    assert ranked["other"] == sigma_about_zero(errors[:, None])[0]


@pytest.mark.parametrize(("apart", "new"), [(0.0, False), (1e-12, False), (3e-9, True)])
def test_a_candidate_that_the_model_holds_already_adds_nothing(apart, new):
    rng = np.random.default_rng(2)
    first, second = rng.standard_normal((2, 60))
    columns = {
        "start": np.column_stack([np.ones(60), first]),
        "again": (2.0 * first - 1.0 + apart * second)[:, None],
        "none": np.zeros((60, 1)),
    }
    y = first + 0.5 * second + 0.1 * rng.standard_normal(60)
    search = search_of(columns, y, 4)
    alone = search._sigma(search.errors(["start"], [0, 1, 2, 3], [0, 1, 2, 3]))
    again, none = search._ranked(["start"], [0, 1, 2, 3]).values()
    assert none == pytest.approx(alone, rel=1e-6)
    if new:
        assert again < 0.5 * alone
    else:
        assert again == pytest.approx(alone, rel=1e-6)


@pytest.mark.parametrize(("least_gain", "taken"), [(0.0, 2), (0.5, 1)])
def test_errors_of_a_choice_are_those_of_folds_left_out(least_gain, taken):
    rng = np.random.default_rng(3)
    a, b = rng.standard_normal((2, 80))
    columns = {"start": np.ones((80, 1)), "a": a[:, None], "b": b[:, None]}
    y = a + 0.3 * b + 0.25 * rng.standard_normal(80)
    search = search_of(columns, y, 4, solver=lb.LeastSquares(), least_gain=least_gain)
    path = search.forward([0, 1, 3])
    assert [name for name, _ in path][:2] == ["start", "a"] and len(path) == 1 + taken
    errors = search.errors(["start", "a"], [1], [0, 1, 3])
    train, test = np.isin(search.fold, [0, 3]), search.fold == 1
    matrix = np.column_stack([np.ones(80), a])
    x = lb.lstsq(matrix[train], y[train]).x
    np.testing.assert_allclose(errors[test], (y - matrix @ x)[test], atol=1e-12)
    assert np.isnan(errors[~test]).all()
    one = search_of(columns, y, 4, least_gain=0.0, at_most=1).forward([0, 1, 2, 3])
    assert len(one) == 2
