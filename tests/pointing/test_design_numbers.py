"""A model bound to a record, each limit from either side: columns made by hand."""

import numpy as np
import pytest

import losbench as lb
from losbench.pointing.thermal.design import bind
from losbench.pointing.thermal.lag import lagged
from losbench.pointing.thermal.terms import Difference, Lagged, Linear, Offset, Steps, Trend

RNG_SEED = 1
T = np.arange(60.0)


def columns_apart():
    """Two orthogonal unit columns without a mean."""
    rng = np.random.default_rng(RNG_SEED)
    return np.linalg.qr(np.column_stack([np.ones(60), rng.standard_normal((60, 2))]))[0][:, 1:].T


@pytest.mark.parametrize(("spread", "varies"), [(2e-8, True), (1.1e-9, True), (0.9e-9, False)])
@pytest.mark.parametrize("unit", [1e-6, 1.0, -300.0])
def test_a_sensor_varies_from_a_billionth_of_its_size_on(spread, varies, unit):
    room = unit * (1.0 - spread * np.linspace(0.0, 1.0, 60))
    if varies:
        assert bind(Linear("room"), {"room": room}, T).reference["room"] == room.mean()
    else:
        with pytest.raises(ValueError, match="sensor room must vary to give a sensitivity"):
            bind(Linear("room"), {"room": room}, T)
    known = bind(Linear("room"), {"room": np.full(60, 20.0)}, T, reference={"room": 19.0})
    np.testing.assert_array_equal(known.fixed[:, 0], 1.0)


@pytest.mark.parametrize(("apart", "alike"), [(1e-8, False), (2e-9, False), (1e-9, True)])
def test_columns_are_alike_below_a_singular_value_of_a_billionth(apart, alike):
    """Two unit columns at an angle have the least singular value angle / sqrt(2)."""
    one, other = columns_apart()
    sensors = {"one": one, "near": one + apart * other}
    found = bind(Linear("one", "near"), sensors, T).alike(np.arange(60))
    assert found.tolist() == [alike, alike]


def test_columns_are_compared_whatever_their_units_and_one_of_zeros_is_alike():
    one, other = columns_apart()
    sensors = {"small": 1e-12 * one, "large": 1e12 * other, "none": np.full(60, 3.0)}
    reference = {"small": 0.0, "large": 0.0, "none": 3.0}
    design = bind(Linear("small", "large", "none"), sensors, T, reference=reference)
    assert design.alike(np.arange(60)).tolist() == [False, False, True]


@pytest.mark.parametrize(("part", "alike"), [(1e-5, True), (2e-6, True), (1e-6, False)])
def test_a_column_has_a_part_in_a_direction_from_a_millionth_on(part, alike):
    one, other = columns_apart()
    sensors = {"one": one, "other": other, "both": one + part * other}
    found = bind(Linear("one", "other", "both"), sensors, T).alike(np.arange(60))
    assert found.tolist() == [True, alike, True]


@pytest.mark.parametrize("step_s", [1e-6, 1.0, 1e6])
def test_a_lag_that_sensors_share_is_counted_in_steps(step_s):
    """A sensor beside its own lag is another column, whatever the steps are."""
    room = np.sin(T / 5.0)
    design = bind(Offset() + Linear("room") + Lagged("room"), {"room": room}, step_s * T)
    assert not design.alike(np.arange(60)).any()
    assert design.alike(np.arange(60), every_lag=True).tolist() == [False, True, True]
    assert design.alike(np.arange(2)).all()


def test_one_sample_has_no_step_and_tells_one_column():
    design = bind(Offset(), {}, np.array([7.0]))
    assert design.alike(np.array([0])).tolist() == [False]
    assert bind(Linear("a"), {"a": [3.0]}, [7.0], reference={"a": 3.0}).alike([0]).tolist() == [
        True
    ]


def test_slopes_of_lags_are_derivatives_in_their_logarithms():
    """Against the closed form behind a ramp: x = T - s tau (1 - exp(-t / tau))."""
    ramp, tau = 0.3 * T, 9.0
    model = Offset() + Linear("ramp") + Lagged("ramp", degree=2)
    design = bind(model, {"ramp": ramp}, T, reference={"ramp": 0.0})
    behind = ramp - 0.3 * tau * (1.0 - np.exp(-T / tau))
    slope = -0.3 * tau * (1.0 - np.exp(-T / tau)) + 0.3 * T * np.exp(-T / tau)
    found = design.slopes(np.array([tau]), np.array([5.0, 7.0, 2.0, -0.5]))
    expected = 2.0 * slope - 0.5 * 2.0 * behind * slope
    np.testing.assert_allclose(found[:, 0], expected, atol=1e-5 * np.abs(expected).max())
    assert bind(Offset(), {}, T).slopes(np.empty(0), np.ones(1)).shape == (60, 0)


def test_columns_and_sensitivities_have_their_places():
    one, other = columns_apart()
    sensors = {"a": one, "b": other, "c": one * other}
    model = (
        Trend(2)
        + Linear("a", "b", degree=2)
        + Difference("a", "b")
        + Lagged("b", "a", degree=3)
        + Steps((5.0,))
        + Lagged("a", tau_s=4.0)
        + Lagged("c")
    )
    design = bind(model, sensors, T)
    assert design.lags == ((3, "b"), (3, "a"), (6, "c"))
    assert design.places == (slice(7, 10), slice(10, 13), slice(15, 16))
    assert design.sensitive() == (2, 4, 6, 7, 10, 14, 15)
    a, b, c = (sensor - sensor.mean() for sensor in sensors.values())
    matrix = design.matrix(np.array([2.0, 3.0, 5.0]))
    expected = [
        *(lagged(b, T, 2.0) ** k for k in (1, 2, 3)),
        *(lagged(a, T, 3.0) ** k for k in (1, 2, 3)),
        T >= 5.0,
        lagged(a, T, 4.0),
        lagged(c, T, 5.0),
    ]
    np.testing.assert_allclose(matrix[:, 7:], np.transpose(expected), atol=1e-12)
    assert (design.fixed[:, 7:13] == 0.0).all() and (design.fixed[:, 15] == 0.0).all()


def test_columns_of_lags_are_made_anew_after_many_others():
    design = bind(Lagged("a"), {"a": np.sin(T)}, T)
    first = design.lagged(0, 1.0)
    assert design.lagged(0, 1.0) is first
    for tau_s in np.arange(2.0, 300.0):
        design.lagged(0, tau_s)
    assert len(design.recent) <= 200
    assert len(repr(design)) == len(repr(bind(Lagged("a"), {"a": np.sin(T)}, T)))
    again = design.lagged(0, 1.0)
    assert again is not first
    np.testing.assert_array_equal(again, first)


def test_gaps_are_filled_along_straight_lines_and_their_rows_are_not_used():
    room = np.where((T > 10) & (T < 14), np.nan, 2.0 * T)
    design = bind(Linear("room"), {"room": room}, T, reference={"room": 0.0})
    np.testing.assert_allclose(design.sensors["room"], 2.0 * T, rtol=1e-12)
    assert np.flatnonzero(~design.known).tolist() == [11, 12, 13]


def test_a_step_is_after_the_first_sample_and_may_be_at_the_last():
    assert bind(Steps((59.0,)), {}, T).fixed[:, 0].sum() == 1.0
    assert bind(Steps((0.5,)), {}, T).fixed[:, 0].sum() == 59.0
    for at in (0.0, 59.5):
        with pytest.raises(ValueError, match="Steps must lie within the record"):
            bind(Offset() + Steps((at,)), {}, T)


@pytest.mark.parametrize(("samples", "enough"), [(4, False), (5, True)])
def test_a_fold_is_predicted_from_a_sample_more_than_unknowns(samples, enough):
    """Offset, a gain and its lag, and another gain: four unknowns."""
    rng = np.random.default_rng(2)
    sensors = {"a": np.sin(T / 4.0), "b": rng.standard_normal(60)}
    y = 1e-6 * (sensors["a"] + sensors["b"] + 0.1 * rng.standard_normal(60))
    y[samples:30] = np.nan
    with np.errstate(all="ignore"):
        found = lb.cross_validate(
            Offset() + Lagged("a") + Linear("b"), y, sensors, T, folds=2, horizon="forward"
        )
    assert found.not_predictable == (("block 1",) if enough else ("block 1", "block 2"))


def test_the_term_that_stands_twice_is_named():
    with pytest.raises(ValueError, match="each term once, got a twice"):
        bind(Offset() + Trend(1) + Linear("b") + Linear("a", "c") + Linear("a"), {}, T)
