"""Batched `irls` against statsmodels' RLM and scipy's least_squares, system by system, with equal
answers.
"""

from side_by_side import faster, in_turn, one_thread, report

one_thread()

import numpy as np  # noqa: E402
from scipy.optimize import least_squares  # noqa: E402
from statsmodels.robust import norms  # noqa: E402
from statsmodels.robust.robust_linear_model import RLM  # noqa: E402

import losbench as lb  # noqa: E402

SYSTEMS, ROWS, UNKNOWNS = 5000, 40, 3
SAMPLE = 100  # systems that the peers solve in each round


class PopulationScale(RLM):
    """RLM with the scale of liu2026."""

    def _estimate_scale(self, resid, *unused):
        return np.std(resid)


def heavy_tails() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(40)
    design = rng.standard_normal((SYSTEMS, ROWS, UNKNOWNS))
    return design, design @ np.ones(UNKNOWNS) + rng.standard_t(2, (SYSTEMS, ROWS))


def against_rlm(design, y, scale, model, at_least):
    def ours():
        return lb.irls(design, y, scale=scale, max_iter=5000, tol=1e-9).x

    def peer():
        fits = [model(y[i], design[i], M=norms.HuberT(1.345)) for i in range(SAMPLE)]
        return np.array([fit.fit(conv="coefs", tol=1e-13, maxiter=5000).params for fit in fits])

    np.testing.assert_allclose(ours()[:SAMPLE], peer(), rtol=0, atol=1e-8)
    ours_s, peer_s = in_turn(ours, peer, rounds=25)
    what = f"irls, Huber, {scale}, {ROWS} x {UNKNOWNS}"
    return faster(what, ours_s / SYSTEMS, "statsmodels RLM", peer_s / SAMPLE, at_least)


def against_scipy(design, y, at_least):
    """The same minimum: Huber's loss at a known scale, the corner of least_squares at 1.345
    scales.
    """

    def ours():
        return lb.irls(design, y, scale=1.0, max_iter=5000).x

    def peer():
        options = {"loss": "huber", "f_scale": 1.345, "xtol": 1e-12, "ftol": 1e-12, "gtol": 1e-12}
        zero = np.zeros(UNKNOWNS)
        return np.array(
            [
                least_squares(
                    lambda x, i=i: design[i] @ x - y[i],
                    zero,
                    jac=lambda x, i=i: design[i],
                    **options,
                ).x
                for i in range(SAMPLE)
            ]
        )

    np.testing.assert_allclose(ours()[:SAMPLE], peer(), rtol=0, atol=1e-5)
    ours_s, peer_s = in_turn(ours, peer, rounds=7)
    what = f"irls, Huber, given, {ROWS} x {UNKNOWNS}"
    return faster(
        what, ours_s / SYSTEMS, 'scipy least_squares(loss="huber")', peer_s / SAMPLE, at_least
    )


if __name__ == "__main__":
    design, y = heavy_tails()
    report(
        "robust",
        [
            against_rlm(design, y, "mad", RLM, 100),
            against_rlm(design, y, "std", PopulationScale, 250),
            against_scipy(design, y, 20),
        ],
    )
