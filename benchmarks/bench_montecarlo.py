"""The Monte Carlo of liu2026's Fig. 1 against drawing its random numbers and doing nothing with
them.
"""

from side_by_side import in_turn, one_thread, report, within

one_thread()

import numpy as np  # noqa: E402

import losbench as lb  # noqa: E402

TRIALS, SEED = 5000, 1
PRECISION_MM = np.array([0.01, 0.1, 0.5])[:, None] * 4.5e-3
TRUTH_RAD = np.full(3, np.deg2rad(0.01))
X, Y, Z = 5.0, 75.0, -475.0
DESIGN = np.array([[0, Z, -Y], [-Z, 0, X], [0, Z, -Y], [-Z, 0, -X]])
SHIFTS_MM = DESIGN @ TRUTH_RAD


def solve(rng, size):
    """Angles of ``size`` trials for each of three precisions, from displacements with noise."""
    return {
        "angles": lb.lstsq(DESIGN, SHIFTS_MM + PRECISION_MM * rng.standard_normal((size, 3, 4))).x
    }


def draw():
    return np.random.default_rng(SEED).standard_normal((TRIALS, 3, 4))


if __name__ == "__main__":
    ours_s, limit_s = in_turn(lambda: lb.monte_carlo(solve, TRIALS, seed=SEED), draw, rounds=1000)
    report(
        "montecarlo",
        [
            within(
                "Fig. 1: 5000 trials x 3 precisions", ours_s, "its random numbers alone", limit_s, 3
            )
        ],
    )
