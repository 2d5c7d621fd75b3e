"""LTS and MM against R, against an exhaustive search, and against as many bad rows as can be."""

import tracemalloc
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from statsmodels.datasets import stackloss

import losbench as lb
from losbench.estimation.highbreakdown import efficient, elimination, search, trimmed
from losbench.estimation.robust.problem import read_problem, spd_inverse

DATA = stackloss.load_pandas()
A = np.column_stack([np.ones(21), DATA.exog.to_numpy()])
Y = DATA.endog.to_numpy()
RNG = np.random.default_rng(11)
FITS = [lb.lts, lb.mm]


def ring(count):
    """Rows (1, 0, -v), (0, 1, u) of spots on a unit circle, and the spot of each row."""
    angle = 2 * np.pi * np.arange(count) / count
    u, v, one, zero = np.cos(angle), np.sin(angle), np.ones(count), np.zeros(count)
    design = np.stack([np.stack([one, zero, -v], axis=1), np.stack([zero, one, u], axis=1)], axis=1)
    return design.reshape(-1, 3), np.repeat(np.arange(count), 2)


def test_mm_of_stackloss_as_robustbase_lmrob():
    fit = lb.mm(A, Y)
    np.testing.assert_allclose(
        fit.x, [-41.5246116702, 0.9388454769, 0.5795527442, -0.1129218620], atol=1e-4
    )
    assert fit.scale == pytest.approx(1.91235190667, abs=1e-4)
    assert fit.converged
    assert fit.outliers().nonzero()[0].tolist() == [3, 20]


def test_lts_of_stackloss_as_robustbase_ltsreg():
    fit = lb.lts(A, Y)
    np.testing.assert_allclose(
        fit.x, [-37.65245890, 0.79768556, 0.57734046, -0.06706018], atol=1e-8
    )
    assert (fit.weights == 0).nonzero()[0].tolist() == [0, 2, 3, 20]
    again = lb.lstsq(A[fit.weights > 0], Y[fit.weights > 0])
    np.testing.assert_allclose(fit.x, again.x, rtol=1e-9)


def trimmed_sum(x, h):
    return np.sort((A @ x - Y) ** 2)[:h].sum()


def test_lts_finds_the_least_trimmed_sum_of_all_subsets():
    """All C(21, 12) of them, one by one; S-PLUS's ltsreg stops at (-35.80556, 0.75, 1/3, 0), which
    is not the least.
    """
    masks = np.zeros((293930, 21))
    np.put_along_axis(masks, np.array(list(combinations(range(21), 12))), 1.0, axis=1)
    scaled = A / np.linalg.norm(A, axis=0)
    normal = np.einsum("kn,ni,nj->kij", masks, scaled, scaled, optimize=True)
    x = np.linalg.solve(
        normal + 1e-15 * np.eye(4), np.einsum("kn,ni,n->ki", masks, scaled, Y)[..., None]
    )[..., 0]
    best = np.argmin(np.sum(masks * (x @ scaled.T - Y) ** 2, axis=1))
    exact = lb.lstsq(A[masks[best] > 0], Y[masks[best] > 0]).x
    assert trimmed_sum(exact, 12) < trimmed_sum(np.array([-35.80556, 0.75, 1 / 3, 0.0]), 12)
    # With a scale that lets no row but those in, the final fit is the raw one.
    np.testing.assert_allclose(lb.lts(A, Y, h=12, scale=1e-9).x, exact, rtol=1e-6)


@pytest.mark.parametrize("fit", FITS)
@pytest.mark.parametrize("count", [3, 4, 5, 6, 7, 8, 9])
def test_a_ring_of_spots_survives_as_many_bad_ones_as_any_estimate_can(fit, count):
    design, spot = ring(count)
    y = np.random.default_rng(count).standard_normal((200, count, 2))
    bad = (count - 2) // 2
    # All bad spots in league: they agree on another attitude.
    y[:, :bad] += (design @ [900.0, -700.0, 1200.0]).reshape(count, 2)[:bad]
    found = fit(design, y.reshape(200, -1), group=spot).x
    assert np.sqrt(np.mean(found**2)) < 2.0
    if bad:
        least = lb.lstsq(design, y.reshape(200, -1)).x
        assert np.abs(least).max() > 50.0


@pytest.mark.parametrize("fit", FITS)
@pytest.mark.parametrize(("n", "p"), [(9, 1), (10, 2), (16, 3), (40, 3), (41, 5)])
def test_almost_half_of_the_rows_may_be_bad(fit, n, p):
    rng = np.random.default_rng(n)
    design, y = rng.standard_normal((6, n, p)), 0.1 * rng.standard_normal((6, n))
    bad = (n - p - 1) // 2
    y[:, :bad] += 1e4 * (1.0 + rng.random((6, bad)))
    result = fit(design, y, on_fail="ignore") if fit is lb.mm else fit(design, y)
    assert np.abs(result.x).max() < 3.0
    assert not result.weights[:, :bad].any()


@pytest.mark.parametrize("fit", FITS)
def test_estimates_follow_the_units_and_the_unknowns(fit):
    design, y = RNG.standard_normal((5, 14, 3)), RNG.standard_t(2, (5, 14))
    base, mix = fit(design, y), RNG.standard_normal((3, 3))
    np.testing.assert_allclose(fit(design, 1e6 * y).x, 1e6 * base.x, rtol=1e-6)
    np.testing.assert_allclose(
        fit(design, y + design @ [1.0, 2.0, 3.0]).x, base.x + np.array([1.0, 2.0, 3.0]), rtol=1e-5
    )
    np.testing.assert_allclose(fit(design @ mix, y).x @ mix.T, base.x, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("fit", FITS)
def test_a_cubic_in_seconds_is_the_cubic_in_megaseconds(fit):
    t = np.linspace(0.5, 2.0, 30)
    y = 1.0 + 2.0 * t**3 + 0.1 * np.random.default_rng(1).standard_normal(30)
    y[[4, 20]] += 30.0
    powers = np.arange(4)
    near, far = fit(t[:, None] ** powers, y), fit((1e6 * t[:, None]) ** powers, y)
    np.testing.assert_allclose(far.x * 1e6**powers, near.x, rtol=1e-6)
    np.testing.assert_allclose(far.weights, near.weights, atol=1e-6)
    assert not near.weights[[4, 20]].any()
    assert near.weights.sum() > 20


@pytest.mark.parametrize("fit", FITS)
@pytest.mark.parametrize(("n", "starts"), [(10, 500), (60, 37)])
def test_starts_in_several_blocks_are_those_in_one(fit, n, starts, monkeypatch):
    design, y = RNG.standard_normal((n, 3)), RNG.standard_t(2, (4, n))
    whole = (
        fit(design, y, starts=starts, on_fail="ignore")
        if fit is lb.mm
        else fit(design, y, starts=starts)
    )
    monkeypatch.setattr(search, "_BLOCK_ELEMENTS", 10 * 3 * n)
    parts = (
        fit(design, y, starts=starts, on_fail="ignore")
        if fit is lb.mm
        else fit(design, y, starts=starts)
    )
    np.testing.assert_allclose(parts.x, whole.x, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(parts.weights, whole.weights, atol=1e-6)


@pytest.mark.parametrize("fit", FITS)
def test_a_long_system_needs_little_memory(fit):
    design = np.random.default_rng(1).standard_normal((20_000, 4))
    tracemalloc.start()
    fit(design, np.random.default_rng(2).standard_normal(20_000), starts=110)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 400e6


def test_many_unknowns_with_leverage_are_found():
    rng = np.random.default_rng(3)
    design, y = rng.standard_normal((200, 20)), 0.1 * rng.standard_normal(200)
    design[:60] += 5.0
    y[:60] += 20.0
    result = lb.lts(design, y)
    assert not result.weights[:60].any()
    assert np.abs(result.x).max() < 0.1


@pytest.mark.parametrize("fit", FITS)
@pytest.mark.parametrize("group", [None, np.arange(16) // 2])
def test_a_batch_is_its_systems_one_by_one(fit, group):
    design, y = RNG.standard_normal((16, 3)), RNG.standard_t(2, (2, 3, 16))
    whole = fit(design, y, group=group)
    own = fit(np.broadcast_to(design, (2, 3, 16, 3)), y, group=group)
    for i, j in np.ndindex(2, 3):
        single = fit(design, y[i, j], group=group)
        for name in ("x", "scale", "weights", "residuals", "cov"):
            np.testing.assert_allclose(
                getattr(whole, name)[i, j], getattr(single, name), rtol=1e-6, atol=1e-9
            )
            np.testing.assert_allclose(
                getattr(own, name)[i, j], getattr(single, name), rtol=1e-6, atol=1e-9
            )


def test_many_systems_go_through_in_parts():
    design, spot = ring(8)
    y = RNG.standard_normal((7000, 16))
    whole = lb.lts(design, y, group=spot)
    np.testing.assert_allclose(
        whole.x[-5:], lb.lts(design, y[-5:], group=spot).x, rtol=1e-9, atol=1e-12
    )


@pytest.mark.parametrize("fit", FITS)
def test_a_known_scale_is_used_and_reported(fit):
    design, spot = ring(8)
    y = 0.5 * np.random.default_rng(11).standard_normal((3000, 16))
    result = fit(design, y, group=spot, scale=0.5)
    assert result.scale_method == "given"
    np.testing.assert_array_equal(result.scale, 0.5)
    if fit is lb.lts:
        assert result.weights.mean() > 0.94
    predicted = np.mean(np.diagonal(result.cov, axis1=1, axis2=2), axis=0)
    ratio = np.mean(result.x**2, axis=0) / predicted
    assert ((ratio > 0.85) & (ratio < (1.3 if fit is lb.lts else 1.12))).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fit", "n", "low", "high"),
    [(lb.mm, 40, 0.95, 1.06), (lb.lts, 40, 1.0, 1.35), (lb.lts, 200, 1.0, 1.15)],
)
def test_predicted_errors_against_the_scatter_on_normal_errors(fit, n, low, high):
    design = np.random.default_rng(2).standard_normal((n, 3))
    y = np.random.default_rng(3).standard_normal((400, n))
    result = fit(design, y)
    ratio = np.sqrt(np.mean(result.x**2) / np.mean(np.diagonal(result.cov, axis1=1, axis2=2)))
    assert low < ratio < high
    assert np.mean(result.scale) == pytest.approx(1.0, abs=0.07)


@pytest.mark.parametrize("fit", FITS)
def test_rows_thrown_out_lend_no_leverage_to_the_predicted_errors(fit):
    x = np.append(np.arange(30.0), [500.0, 510.0, 520.0])
    design = np.column_stack([np.ones(33), x])
    y = np.random.default_rng(6).standard_normal((1500, 33))
    y[:, 30:] += 1000.0
    result = fit(design, y)
    assert not result.weights[:, 30:].any()
    ratio = np.sqrt(
        np.mean(result.x**2, axis=0) / np.mean(np.diagonal(result.cov, axis1=1, axis2=2), axis=0)
    )
    assert ((ratio > 0.9) & (ratio < (1.35 if fit is lb.lts else 1.12))).all()


@pytest.mark.slow
@pytest.mark.parametrize(("efficiency", "rows"), [(0.85, 1), (0.95, 1), (0.95, 2)])
def test_mm_has_the_efficiency_asked_for(efficiency, rows):
    n = 60
    design, group = np.tile(np.eye(2), (n // 2, 1)), None if rows == 1 else np.arange(n) // 2
    y = np.random.default_rng(5).standard_normal((1500, n))
    found = lb.mm(design, y, efficiency=efficiency, group=group).x
    ratio = lb.lstsq(design, y).x.var() / found.var()
    assert ratio == pytest.approx(efficiency, abs=0.03)


def test_random_starts_repeat_and_can_be_drawn_anew():
    rng = np.random.default_rng(11)
    design = rng.standard_normal((60, 4))
    y = design @ np.ones(4) * np.repeat([-3.0, 5.0], 30) + rng.standard_normal(60)
    for fit in FITS:
        np.testing.assert_array_equal(fit(design, y).x, fit(design, y, rng=None).x)
        np.testing.assert_array_equal(
            fit(design, y, rng=3).x, fit(design, y, rng=np.random.default_rng(3)).x
        )
        few = [fit(design, y, starts=1, rng=seed).x for seed in range(6)]
        assert np.ptp(few, axis=0).max() > 1.0


@pytest.mark.parametrize("fit", FITS)
@pytest.mark.parametrize("seed", range(12))
def test_a_perfect_majority_is_found_and_the_rest_thrown_out(fit, seed):
    design = np.random.default_rng(seed).standard_normal((12, 3))
    y = design @ [1.0, -2.0, 3.0]
    y[:4] += [1e9, -3.0, 1e3, 7.0]
    result = fit(design, y)
    np.testing.assert_allclose(result.x, [1.0, -2.0, 3.0], atol=1e-5)
    assert not result.weights[:4].any()


@pytest.mark.parametrize("fit", FITS)
@pytest.mark.parametrize("p", [1, 2, 3, 4])
def test_as_many_rows_as_unknowns_is_an_equation(fit, p):
    design = RNG.standard_normal((p, p))
    result = fit(design, design @ np.arange(1.0, p + 1))
    np.testing.assert_allclose(result.x, np.arange(1.0, p + 1), rtol=1e-8)
    assert result.dof == 0
    np.testing.assert_allclose(result.weights, 1.0, atol=1e-3)


@settings(deadline=None, max_examples=150)
@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(1, 9),
    p=st.integers(1, 4),
    size=st.integers(-300, 290),
    kind=st.sampled_from(
        ["ties", "zeros", "normal", "outliers", "equal rows", "zero column", "perfect"]
    ),
    fit=st.sampled_from(FITS),
    rows=st.integers(1, 3),
)
def test_weights_and_unknowns_are_always_numbers(seed, n, p, size, kind, fit, rows):
    n = max(n, p)
    rng = np.random.default_rng(seed)
    a = rng.integers(-2, 3, (n, p)).astype(float)
    y = {
        "ties": rng.integers(-1, 2, n).astype(float),
        "zeros": np.zeros(n),
        "normal": rng.standard_normal(n),
        "outliers": np.where(np.arange(n) > 0, 1e9 * rng.standard_normal(n), 1.0),
        "equal rows": np.ones(n),
        "zero column": rng.standard_normal(n),
        "perfect": a @ np.arange(1.0, p + 1),
    }[kind]
    if kind == "equal rows":
        a[:] = a[0]
    if kind == "zero column":
        a[:, 0] = 0.0
    result = fit(a, y * 10.0**size, group=np.arange(n) // rows, starts=20, on_fail="ignore")
    assert np.isfinite(result.x).all()
    assert ((result.weights >= 0.0) & (result.weights <= 1.0)).all()
    assert np.isfinite(result.residuals).all()
    assert result.scale >= 0.0


BAD = [
    (lb.lts, {"h": 2}, r"h must be a whole number from 3 to 8, got 2"),
    (lb.lts, {"h": 9}, r"h must be a whole number from 3 to 8, got 9"),
    (lb.mm, {"efficiency": 1.5}, r"efficiency must be a finite number from 0 to 1, got 1\.5"),
    (lb.mm, {"efficiency": 1.0}, r"efficiency must be within what Bisquare can have, .*, got 1"),
    *((fit, {"starts": 0}, r"starts must be a whole number of at least 1, got 0") for fit in FITS),
    *((fit, {"scale": -1.0}, r"scale must be positive, got -1") for fit in FITS),
    *(
        (fit, {"scale": True}, r"scale must be a name, a number or a callable, got True")
        for fit in FITS
    ),
    *(
        (fit, {"rng": rng}, r"rng must be a numpy Generator or a seed of at least 0, got")
        for fit in FITS
        for rng in ("a", 1.5, True)
    ),
    (
        lb.lts,
        {"y": np.arange(8).astype("datetime64[s]")},
        r"y must be an array of numbers, got ndarray of datetime64",
    ),
    (
        lb.mm,
        {"y": np.arange(8).astype("timedelta64[s]")},
        r"y must be an array of numbers, got ndarray of timedelta64",
    ),
    (lb.lts, {"y": ["1"] * 8}, r"y must be an array of numbers, got list"),
    (lb.mm, {"y": np.full(8, 1.0j)}, r"y must be an array of numbers, got ndarray of complex128"),
    *(
        (fit, {"group": [1]}, r"group must have shape \(8,\) to match the 8 rows of A, got \(1,\)")
        for fit in FITS
    ),
    *(
        (fit, {"y": np.full(8, np.nan)}, r"y must be finite, got 8 NaN or infinite of 8 values")
        for fit in FITS
    ),
    *(
        (
            fit,
            {"y": np.zeros(7)},
            r"y must have shape \(\.\.\., 8\) to match the 8 rows of A, got \(7,\)",
        )
        for fit in FITS
    ),
]


@pytest.mark.parametrize(("fit", "change", "message"), BAD)
def test_bad_input_is_refused_by_name(fit, change, message):
    arguments = {"A": RNG.standard_normal((8, 3)), "y": RNG.standard_normal(8)} | change
    with pytest.raises(ValueError, match=message):
        fit(**arguments)


# What makes it fast


@pytest.mark.parametrize("p", [1, 2, 3, 5])
def test_elimination_leaves_what_each_subset_leaves(p):
    rng = np.random.default_rng(p)
    design, y = rng.standard_normal((4, 9, p)), rng.standard_normal((4, 9))
    subsets = (rng.random((40, 9)) < 0.8).astype(float)
    subsets[:, : p + 1] = 1.0
    problem = read_problem(design, y)
    left, safe = elimination.misfits(problem, subsets)
    assert safe.all()
    for b in range(4):
        for k, subset in enumerate(subsets):
            rows = subset > 0
            x = np.linalg.lstsq(design[b, rows], y[b, rows])[0]
            wanted = np.sum((design[b, rows] @ x - y[b, rows]) ** 2)
            np.testing.assert_allclose(left[b, k], wanted, atol=1e-12)
    design[2, :, 0] = np.arange(9) == 8
    subsets[:, 8] = np.arange(40) > 0
    assert elimination.misfits(read_problem(design, y), subsets)[1].tolist() == [
        True,
        True,
        False,
        True,
    ]


@pytest.mark.parametrize("p", [2, 4, 6])
def test_sweeping_inverts_what_can_be_inverted(p):
    factors = np.random.default_rng(p).standard_normal((400, p + 2, p))
    factors[7, :, -1] = factors[7, :, 0]
    matrices = np.swapaxes(factors, 1, 2) @ factors
    packed = matrices[:, *np.triu_indices(p)]
    found = elimination.inverses(packed, p)
    np.testing.assert_allclose(found, spd_inverse(packed, p), rtol=1e-6, atol=1e-9)
    regular = np.arange(400) != 7
    unit = found[regular] @ matrices[regular]
    np.testing.assert_allclose(unit, np.broadcast_to(np.eye(p), unit.shape), atol=1e-6)


@pytest.mark.parametrize("group", [False, True])
def test_some_rows_of_a_long_system_find_what_all_rows_find(monkeypatch, group):
    rng = np.random.default_rng(9)
    design = np.column_stack([np.ones(5000), rng.standard_normal((5000, 3))])
    y = design @ [1.0, 2.0, 3.0, 4.0] + rng.standard_normal((2, 5000))
    y[:, :1600] += 25.0
    design[:1600, 1] += 5.0
    options = {"group": np.arange(5000) // 2} if group else {}
    monkeypatch.setattr(efficient, "LONG", 2000)
    quick = lb.mm(design, y, **options)
    monkeypatch.setattr(efficient, "LONG", 10**9)
    whole = lb.mm(design, y, starts=100, **options)
    np.testing.assert_allclose(quick.x, whole.x, atol=1e-6)
    np.testing.assert_allclose(quick.scale, whole.scale, rtol=1e-6)
    monkeypatch.setattr(trimmed, "LONG", 2000)
    near = lb.lts(design, y, **options)
    np.testing.assert_allclose(near.x, [[1.0, 2.0, 3.0, 4.0]] * 2, atol=0.1)
    assert (near.weights[:, :1600] == 0).all()


def test_a_long_system_with_a_rank_too_short_is_solved():
    rng = np.random.default_rng(10)
    design = rng.standard_normal((5000, 3))
    design[:, 2] = design[:, 0]
    y = design @ [1.0, 2.0, 1.0] + rng.standard_normal(5000)
    for fit in FITS:
        with pytest.warns(RuntimeWarning, match="do not determine"):
            found = fit(design, y)
        np.testing.assert_allclose(found.x, [1.0, 2.0, 1.0], atol=0.1)


@pytest.mark.parametrize("fit", [lb.lts, lb.mm])
@pytest.mark.parametrize("p", [1, 2, 3])
def test_as_many_rows_as_unknowns_leave_no_error_but_that_of_a_known_scale(fit, p):
    rng = np.random.default_rng(p)
    design, x = rng.standard_normal((p, p)), np.arange(1.0, p + 1)
    plain = fit(design, design @ x)
    np.testing.assert_allclose(plain.x, x, rtol=1e-8)
    assert plain.dof == 0 and np.isnan(plain.cov).all()
    known = fit(design, design @ x, scale=0.1)
    np.testing.assert_allclose(known.cov, 0.01 * np.linalg.inv(design.T @ design), rtol=1e-6)
