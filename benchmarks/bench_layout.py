"""Two spots in closed form against the iteration it stands for, and the full search for the layouts
of Table 2 against one fit from a stored start.
"""

from side_by_side import faster, in_turn, one_thread, report, within

one_thread()

import numpy as np  # noqa: E402

import losbench as lb  # noqa: E402
from losbench.papers import liu2026  # noqa: E402

POINTS_MM = np.array([[4.68, 3.36], [9.48, 0.87]])
SHIFTS_MM = 2e-4 * np.random.default_rng(1).standard_normal((10_000, 2, 2))
ROWS = lb.design_matrix(np.column_stack([POINTS_MM, [-260.0, -260.0]]), model="paper")
STORED = (7.18, 1.96, 153.5)


def closed():
    return liu2026.two_spot_angles(POINTS_MM, SHIFTS_MM, focal_mm=260.0, scale="run")


def iterated():
    return lb.irls(ROWS, SHIFTS_MM.reshape(-1, 4), scale="pooled", max_iter=1000, on_fail="ignore")


if __name__ == "__main__":
    closed_s, iterated_s = in_turn(closed, iterated, rounds=3)
    search_s, fit_s = in_turn(
        lambda: liu2026.fit_table_2(), lambda: liu2026.fit_table_2(start=STORED), rounds=1
    )
    report(
        "layout",
        [
            faster("two spots, one c for the run", closed_s, "irls(scale='pooled')", iterated_s, 5),
            within("layouts of Table 2: full search", search_s, "one fit", fit_s, 20),
        ],
    )
