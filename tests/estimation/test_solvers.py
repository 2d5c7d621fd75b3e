"""Authority: the calls that the objects stand for, and the closed form of two spots."""

import pickle

import numpy as np
import pytest

import losbench as lb

RNG = np.random.default_rng(3)
A, Y = RNG.standard_normal((12, 3)), RNG.standard_normal((4, 12))
Y[:, 0] += 30.0
GROUP = np.arange(12) // 2
F_MM, PIXEL_MM = 260.0, 0.01
TWO_SPOTS = np.array([[4.68, 3.36, -F_MM], [9.48, 0.87, -F_MM]])
SHIFTS_PX = np.array(
    [
        [[0.02, -0.01], [-0.05, 0.012]],
        [[0.06, 0.004], [-0.03, -0.02]],
        [[-0.005, 0.008], [0.004, -0.003]],
    ]
)

two_spots_warn = pytest.warns(UserWarning, match="with two spots per solve")


PAIRS = [
    (lb.LeastSquares(), lambda group: lb.lstsq(A, Y)),
    (lb.LeastSquares(scale=2.0), lambda group: lb.lstsq(A, Y, scale=2.0)),
    (lb.IRLS(), lambda group: lb.irls(A, Y, group=group)),
    (
        lb.IRLS("cauchy", scale="std", leverage=True, max_iter=300, tolerance=1e-6),
        lambda group: lb.irls(
            A,
            Y,
            loss=lb.Cauchy(),
            scale="std",
            leverage=True,
            max_iter=300,
            tolerance=1e-6,
            group=group,
        ),
    ),
    (lb.LTS(h=9, scale=0.5), lambda group: lb.lts(A, Y, h=9, scale=0.5, group=group)),
    (lb.LTS(starts=7, seed=4), lambda group: lb.lts(A, Y, starts=7, seed=4, group=group)),
    (
        lb.MM(efficiency=0.85, seed=2),
        lambda group: lb.mm(A, Y, efficiency=0.85, seed=2, group=group),
    ),
    (lb.MM(scale=0.5, starts=9), lambda group: lb.mm(A, Y, scale=0.5, starts=9, group=group)),
]


@pytest.mark.parametrize(("solver", "call"), PAIRS, ids=lambda value: repr(value)[:20])
@pytest.mark.parametrize("group", [None, GROUP], ids=["rows", "groups"])
def test_a_solver_is_its_call(solver, call, group):
    if isinstance(solver, lb.LTS) and solver.h is not None and group is not None:
        solver, call = (
            lb.LTS(h=5, scale=0.5),
            lambda group: lb.lts(A, Y, h=5, scale=0.5, group=group),
        )
    here, there = pickle.loads(pickle.dumps(solver)).fit(A, Y, group), call(group)
    for name in ("x", "weights", "scale", "cov", "converged"):
        np.testing.assert_array_equal(getattr(here, name), getattr(there, name))


def test_names_of_losses_are_their_objects():
    assert lb.IRLS("huber") == lb.IRLS() == lb.IRLS(lb.Huber(1.345))
    for name, loss in {
        "huber": lb.Huber(),
        "bisquare": lb.Bisquare(),
        "cauchy": lb.Cauchy(),
        "welsch": lb.Welsch(),
        "hampel": lb.Hampel(),
    }.items():
        named, given = (lb.irls(A, Y, loss=each, max_iter=500) for each in (name, loss))
        np.testing.assert_array_equal(named.x, given.x)
        assert named.loss == given.loss == repr(loss)
    with pytest.raises(ValueError, match="loss must be one of 'huber', .*'hampel', got 'hubert'"):
        lb.IRLS("hubert")
    with pytest.raises(ValueError, match="got the class Huber itself"):
        lb.IRLS(lb.Huber)


# Two words


@pytest.mark.parametrize("fit", [lb.lts, lb.mm])
def test_seed_and_rng_are_one_thing(fit):
    design, y = RNG.standard_normal((40, 3)), RNG.standard_normal(40)
    first = fit(design, y, seed=5, starts=9)
    for again in (
        fit(design, y, rng=5, starts=9),
        fit(design, y, seed=np.random.default_rng(5), starts=9),
    ):
        np.testing.assert_array_equal(first.x, again.x)
    with pytest.raises(ValueError, match="seed and rng are one thing, got both: give seed alone"):
        fit(design, y, seed=5, rng=6)


def test_tolerance_and_tol_are_one_thing():
    one, other = lb.irls(A, Y, tolerance=1e-3), lb.irls(A, Y, tol=1e-3)
    np.testing.assert_array_equal(one.x, other.x)
    assert one.n_iter.sum() < lb.irls(A, Y).n_iter.sum()
    with pytest.raises(ValueError, match="tolerance and tol are one thing"):
        lb.irls(A, Y, tolerance=1e-3, tol=1e-4)


# One scale for all


def closed_form(shifts, bound):
    """Angles (..., 3) of two spots by Huber's loss at rows bounded by ``bound``: A x = b in (alpha,
    beta, gamma) has two unknowns that shift both spots and one, gamma, that turns the baseline."""
    a, b = TWO_SPOTS[:, :2]
    d = np.linalg.norm(a - b)
    e, middle = (a - b) / d, (a + b) / 2
    across = np.array([-e[1], e[0]])
    delta, mu = shifts[..., 0, :] - shifts[..., 1, :], shifts.mean(axis=-2)
    s = delta @ e / 2
    gamma = delta @ across / d
    i, j = (0, 1) if abs(e[0]) >= abs(e[1]) else (1, 0)
    limit = np.minimum(np.abs(s), bound / abs(e[i]))
    r_j = limit * abs(e[j])
    r_i = (np.abs(s) - abs(e[j]) * r_j) / abs(e[i])
    excess = r_i - limit * abs(e[i])
    gamma = gamma - 2 * across[i] * np.sign(s) * np.sign(e[i]) * excess / d
    square = (r_i**2 + r_j**2) / 2
    alpha = (mu[..., 1] - middle[0] * gamma) / F_MM
    beta = -(mu[..., 0] + middle[1] * gamma) / F_MM
    return np.stack([alpha, beta, gamma], axis=-1), square


def run_wide(shifts):
    bound = np.inf
    for _ in range(200):
        angles, square = closed_form(shifts, bound)
        before, bound = bound, 1.345 * np.sqrt(square.mean())
        if bound == before:
            break
    return angles, bound / 1.345


def pooled(shifts, **options):
    with two_spots_warn:
        return lb.solve_attitude(
            TWO_SPOTS,
            shifts,
            model="paper",
            group=None,
            solver=lb.IRLS(scale="pooled", max_iter=3000, tolerance=1e-14, **options),
        )


def test_a_pooled_scale_is_that_of_the_closed_form_of_two_spots():
    shifts = PIXEL_MM * SHIFTS_PX
    fit, (angles, scale) = pooled(shifts), run_wide(shifts)
    to_arcsec = 180 * 3600 / np.pi
    np.testing.assert_allclose(fit.angles_arcsec, to_arcsec * angles, rtol=0, atol=1e-9)
    np.testing.assert_allclose(
        fit.angles_arcsec,
        [
            [0.086619, 0.142505, -2.889597],
            [0.553492, 0.065304, -22.656641],
            [0.078209, 0.021405, -2.143764],
        ],
        atol=6e-7,
    )
    np.testing.assert_allclose(fit.scale, scale, rtol=1e-10)


def test_many_frames_share_the_scale_of_the_closed_form():
    shifts = PIXEL_MM * 0.05 * np.random.default_rng(8).standard_normal((3000, 2, 2))
    fit, (angles, scale) = pooled(shifts), run_wide(shifts)
    np.testing.assert_allclose(fit.angles_arcsec, 180 * 3600 / np.pi * angles, rtol=0, atol=1e-9)
    assert fit.converged.all()
    np.testing.assert_allclose(fit.scale, scale, rtol=1e-10)


@pytest.mark.parametrize("leverage", [False, True])
def test_the_pooled_scale_is_what_all_residuals_leave(leverage):
    unit = np.array([1.0, 1.0, 1.0, 1e-150])[:, None]  # a system that is scaled to be squared
    y = unit * Y
    fit = lb.irls(A, y, scale="pooled", leverage=leverage, max_iter=500)
    assert fit.converged.all()
    judged = fit.residuals / np.sqrt(1 - fit.leverage) if leverage else fit.residuals
    np.testing.assert_allclose(fit.scale, np.sqrt(np.mean(judged**2)), rtol=1e-9)
    at_that = lb.irls(A, y, scale=float(fit.scale[0]), leverage=leverage, max_iter=500)
    np.testing.assert_allclose(fit.x, at_that.x, rtol=1e-8)
    assert fit.scale_method == "pooled"


def test_a_pooled_scale_of_one_system_is_its_rms():
    one, other = (lb.irls(A, Y[0], scale=scale, max_iter=500) for scale in ("pooled", "rms"))
    np.testing.assert_allclose(one.x, other.x, rtol=1e-8)
    np.testing.assert_allclose(one.cov, other.cov, rtol=1e-7)


def test_the_pooled_covariance_is_that_of_many_draws():
    y = np.random.default_rng(5).standard_normal((4000, 12))
    y[::50, 3] += 20.0
    fit = lb.irls(A, y, scale="pooled", max_iter=500)
    assert (np.ptp(fit.cov, axis=0) <= 1e-12 * fit.cov.max()).all()
    clean = np.arange(4000) % 50 != 0
    scatter = np.cov(fit.x[clean].T)
    np.testing.assert_allclose(np.diag(fit.cov[0]), np.diag(scatter), rtol=0.08)


def test_pooled_frames_must_be_whole_and_their_own():
    shifts = np.zeros((9, 2, 2))
    shifts[3, 1] = np.nan
    with two_spots_warn, pytest.raises(ValueError, match="needs every spot in every frame"):
        lb.solve_attitude(TWO_SPOTS, shifts, scale="pooled")
    with pytest.raises(ValueError, match="windows share their frames"):
        lb.track_attitude(TWO_SPOTS, shifts, solver=lb.IRLS(scale="pooled"))


def test_a_pooled_scale_stops_at_its_limit_of_rounds():
    with pytest.warns(RuntimeWarning, match="4 of 4 systems did not converge in 1 iterations"):
        assert not lb.irls(A, Y, scale="pooled", max_iter=1).converged.any()
