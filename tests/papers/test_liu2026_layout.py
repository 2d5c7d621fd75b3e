"""Two spots in closed form against the iteration that they stand for, and Table 2 as a fit."""

import numpy as np
import pytest

import losbench as lb
from losbench.papers.liu2026.results import layout
from losbench.papers.liu2026.results.angles import TABLE_2
from losbench.papers.liu2026.results.layout import FITTED, LayoutModel, fit_table_2
from losbench.papers.liu2026.results.twospots import alpha_bound, two_spot_angles
from losbench.papers.liu2026.scenario import Bench
from losbench.units import rad_to_arcsec

POINTS = np.array([[4.68, 3.36], [9.48, 0.87]])
SHIFTS = 1e-2 * np.array(
    [
        [[0.02, -0.01], [-0.05, 0.012]],
        [[0.06, 0.004], [-0.03, -0.02]],
        [[-0.005, 0.008], [0.004, -0.003]],
    ]
)
LEAST = [
    [0.139900, 0.158421, -4.846219],
    [0.588297, 0.075702, -23.934819],
    [0.078209, 0.021405, -2.143764],
]
STORED = (7.08, 2.1, 152.5)


@pytest.mark.parametrize(
    ("scale", "expected"),
    [
        (None, LEAST),
        ("frame", LEAST),
        (
            2e-4,
            [[-0.006694, 0.114629, 0.537148], [0.460179, 0.037429, -19.229896], LEAST[2]],
        ),
        (
            "run",
            [[0.086619, 0.142505, -2.889597], [0.553492, 0.065304, -22.656641], LEAST[2]],
        ),
    ],
)
def test_the_closed_form_has_the_values_worked_by_hand(scale, expected):
    found = rad_to_arcsec(two_spot_angles(POINTS, SHIFTS, focal_mm=260.0, scale=scale))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    "points",
    [
        [[4.68, 3.36], [9.48, 0.87]],
        [[-3.0, -4.0], [-1.0, 1.0]],
        [[5.0, -2.0], [-4.0, 3.0]],
        [[0.5, 0.0], [-0.5, 2.0]],
    ],
)
def test_the_closed_form_is_what_irls_converges_to(points):
    rng = np.random.default_rng(5)
    points = np.array(points)
    shifts = 2e-4 * rng.standard_normal((400, 2, 2))
    matrix = lb.design_matrix(np.column_stack([points, [-260.0, -260.0]]), model="paper")
    y, c = shifts.reshape(-1, 4), 1e-4
    # A scale of c / k and Huber(k) is a bend at c.
    iterated = lb.irls(
        matrix,
        y,
        loss=lb.Huber(1.345),
        scale=c / 1.345,
        tol=1e-14,
        max_iter=20000,
        on_fail="ignore",
    ).x
    closed = two_spot_angles(points, shifts, focal_mm=260.0, scale=c)
    assert np.abs(rad_to_arcsec(iterated - closed)).max() < 1e-6
    least = two_spot_angles(points, shifts, focal_mm=260.0)
    assert np.abs(rad_to_arcsec(lb.lstsq(matrix, y).x - least)).max() < 1e-9
    assert np.abs(rad_to_arcsec(closed - least)).max() > 0.1


def test_in_a_row_or_column_no_c_moves_the_angles():
    shifts = 2e-4 * np.random.default_rng(1).standard_normal((100, 2, 2))
    for points in ([[3.0, 2.0], [-2.0, 2.0]], [[3.0, 2.0], [3.0, -4.0]]):
        least, robust = (
            two_spot_angles(np.array(points), shifts, focal_mm=260.0, scale=scale)
            for scale in (None, 1e-5)
        )
        np.testing.assert_allclose(robust, least, rtol=0, atol=1e-16)


def test_with_c_of_the_frame_the_gain_stays_below_the_bound_of_one_percent():
    rng = np.random.default_rng(2)
    for _ in range(20):
        points = rng.uniform([-9.6, -5.4], [9.6, 5.4], (2, 2))
        shifts = 2e-4 * rng.standard_normal((4000, 2, 2))
        least, robust = (
            two_spot_angles(points, shifts, focal_mm=260.0, scale=scale).std(axis=0)
            for scale in (None, "frame")
        )
        assert (robust / least).min() > 0.9898 - 0.001


def test_the_bound_needs_no_estimator():
    rng = np.random.default_rng(3)
    bench = Bench()
    assert alpha_bound("rms", 0.485, setting=bench).total == pytest.approx(0.100, abs=5e-4)
    assert alpha_bound(
        "rms", 0.485, setting=bench, column="eiwa in the text"
    ).total == pytest.approx(0.110, abs=1e-3)
    assert alpha_bound("pv", 1.365, setting=bench).total == pytest.approx(0.457, abs=1e-3)
    points = np.array([[9.6, 3.0], [4.0, -2.0]])
    shifts = rng.standard_normal((300, 2, 2)) * 1e-4
    matrix = lb.design_matrix(np.column_stack([points, [-260.0] * 2]), model="paper")
    for _ in range(10):
        w = np.sqrt(rng.uniform(0.0, 1.0, (300, 4)))
        x = lb.lstsq(w[..., None] * matrix, w * shifts.reshape(-1, 4)).x
        limit = shifts[..., 1].std(axis=0).max() / 260.0 + 9.6 / 260.0 * x[:, 2].std()
        assert x[:, 0].std() <= limit + 1e-12


def test_an_oblique_layout_and_one_c_for_the_run_give_the_eight_statistics():
    fit = fit_table_2(start=STORED, blocks=100)
    assert fit.dof == 5
    assert fit.p_value > 0.05
    assert fit.on_sensor
    assert np.abs(fit.pulls[:FITTED]).max() < 3.0
    assert fit.gamma_factor == pytest.approx(20.2, rel=0.15)
    rms = TABLE_2["LS"]["rms"][2] * fit.gamma_factor
    assert rms == pytest.approx(np.exp(fit.mean[-1]), rel=1e-12)


def test_no_layout_fits_with_c_of_the_frame():
    model = LayoutModel(scale="frame", blocks=60)
    assert model.fit(np.array(STORED), rounds=1).chi2 > 200.0


def test_least_squares_in_the_place_of_irls_fits_nowhere(monkeypatch):
    real = two_spot_angles
    monkeypatch.setattr(
        layout, "two_spot_angles", lambda *a, scale=None, **k: real(*a, scale=None, **k)
    )
    model = LayoutModel(blocks=60)
    printed, rounding = layout.table_2_statistics()
    values = model.statistics(np.array(STORED))
    rest = (printed - values.mean(axis=0))[2:FITTED]
    assert np.abs(rest / np.sqrt(np.diag(rounding)[2:FITTED])).max() > 3.0


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"column": "egg"}, "column must be"),
        ({"scale": "std"}, "scale must be"),
        ({"form": "odd"}, "form must be"),
        ({"blocks": 3}, "blocks must be"),
    ],
)
def test_an_unknown_reading_is_refused_by_name(wrong, message):
    with pytest.raises(ValueError, match=message):
        fit_table_2(**wrong)


def test_one_c_for_the_run_is_the_pooled_scale_of_irls():
    shifts = 2e-4 * np.random.default_rng(7).standard_normal((300, 2, 2))
    matrix = lb.design_matrix(np.column_stack([POINTS, [-260.0, -260.0]]), model="paper")
    pooled = lb.irls(matrix, shifts.reshape(-1, 4), scale="pooled", tol=1e-15, max_iter=20000).x
    closed = two_spot_angles(POINTS, shifts, focal_mm=260.0, scale="run")
    assert np.abs(rad_to_arcsec(pooled - closed)).max() < 1e-9
