"""Many robust systems at once: `irls` against statsmodels, `lts` and `mm` over frames and against
robustat-py, how times and memory grow.
"""

import resource

from side_by_side import faster, in_turn, one_thread, report, within

one_thread()

import numpy as np  # noqa: E402
from robustat_py import Lts, MMEstimator  # noqa: E402
from statsmodels.robust import norms  # noqa: E402
from statsmodels.robust.robust_linear_model import RLM  # noqa: E402

import losbench as lb  # noqa: E402

SAMPLE = 60  # systems that a peer solves one by one
FRAMES = 10_000


def frames_of_eight_spots() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Design, shifts and spot of each row: three of eight spots bad and in league."""
    turn = 2 * np.pi * np.arange(8) / 8
    design = lb.design_matrix(
        np.column_stack([np.cos(turn), np.sin(turn), np.ones(8)]), model="paper"
    )
    shifts = np.random.default_rng(8).standard_normal((FRAMES, 16))
    shifts[:, :6] += (design @ [90.0, -70.0, 120.0])[:6]
    return design, shifts, np.repeat(np.arange(8), 2)


def systems(count: int, n: int, p: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(n)
    design = rng.standard_normal((count, n, p))
    return design, design @ np.ones(p) + rng.standard_t(3, (count, n))


def hundred_thousand():
    """100 000 systems of 16 x 3 in one call; statsmodels solves a sample of them, with equal
    answers.
    """
    design, y = systems(100_000, 16, 3)

    def ours():
        return lb.irls(design, y, max_iter=2000).x

    def peer():
        fits = [RLM(y[i], design[i], M=norms.HuberT(1.345)) for i in range(SAMPLE)]
        return np.array([fit.fit(conv="coefs", tol=1e-12, maxiter=5000).params for fit in fits])

    np.testing.assert_allclose(ours()[:SAMPLE], peer(), rtol=0, atol=1e-7)
    ours_s, peer_s = in_turn(ours, peer, rounds=3)
    return faster(
        "irls, 100 000 of 16 x 3", ours_s / 100_000, "statsmodels RLM", peer_s / SAMPLE, 100
    )


def plain_lts(design: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The exact LTS of one frame, a least-squares fit for each subset of five spots."""
    from itertools import combinations

    best, x = np.inf, np.zeros(3)
    for spots in combinations(range(8), 5):
        rows = np.concatenate([[2 * s, 2 * s + 1] for s in spots])
        found, rss, *_ = np.linalg.lstsq(design[rows], y[rows])
        if rss[0] < best:
            best, x = rss[0], found
    return x


def lts_against_a_loop():
    design, shifts, spot = frames_of_eight_spots()

    def ours():
        return lb.lts(
            design, shifts, group=spot, scale=1e-9
        ).x  # a scale that lets no row in: the raw estimate

    def peer():
        return np.array([plain_lts(design, y) for y in shifts[:SAMPLE]])

    np.testing.assert_allclose(ours()[:SAMPLE], peer(), atol=1e-9)
    ours_s, peer_s = in_turn(ours, peer, rounds=3)
    return faster(
        "lts, 8 spots, 10 000 frames",
        ours_s / FRAMES,
        "a loop over subsets, numpy",
        peer_s / SAMPLE,
        50,
    )


def mm_against_lts():
    design, shifts, spot = frames_of_eight_spots()
    mm_s, lts_s = in_turn(
        lambda: lb.mm(design, shifts, group=spot, on_fail="ignore"),
        lambda: lb.lts(design, shifts, group=spot),
        rounds=3,
    )
    return within(
        "mm, 8 spots, 10 000 frames", mm_s / FRAMES, "lts of the same", lts_s / FRAMES, 60
    )


def robustat(estimator, solve, name, n):
    """Batches against a compiled peer that takes one system at a time."""
    design, y = systems(200, n, 3)

    def peer():
        return [
            estimator().fit(a, b).coefficients for a, b in zip(design[:20], y[:20], strict=True)
        ]

    ours_s, peer_s = in_turn(lambda: solve(design, y, on_fail="ignore"), peer, rounds=3)
    return faster(f"{name}, 200 of {n} x 3", ours_s / 200, "robustat-py", peer_s / 20, 3)


def long_system():
    """One system of 13 895 x 6 by `mm`, in units of half a second."""
    rng = np.random.default_rng(13)
    design = rng.standard_normal((13_895, 6))
    y = design @ np.ones(6) + rng.standard_t(3, 13_895)
    ours_s, least_s = in_turn(lambda: lb.mm(design, y), lambda: lb.lstsq(design, y), rounds=3)
    print(f"least squares of the same: {1e3 * least_s:.1f} ms")
    return within("mm, 13 895 x 6", ours_s, "half a second", 0.5, 1.0)


def scaling(solve, name, small, large, at_most):
    """Time per row of the batch as it grows from one shape (systems, n, p) to another."""
    few, many = systems(*small), systems(*large)
    large_s, small_s = in_turn(lambda: solve(*many), lambda: solve(*few), rounds=3)
    shapes = ["{} of {} x {}".format(*shape) for shape in (large, small)]
    per_row = [
        seconds / (shape[0] * shape[1]) for seconds, shape in ((large_s, large), (small_s, small))
    ]
    return within(f"{name}, {shapes[0]}, per row", per_row[0], shapes[1], per_row[1], at_most)


def memory():
    """Peak memory of everything above, in units of a gigabyte: the columns of times hold it in
    microbytes.
    """
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    return within("peak memory of this run, GB", 1e-6 * peak / 1e9, "1 GB", 1e-6, 1.0)


def huber(design, y):
    return lb.irls(design, y, max_iter=2000)


if __name__ == "__main__":
    report(
        "highbreakdown",
        [
            hundred_thousand(),
            lts_against_a_loop(),
            mm_against_lts(),
            scaling(huber, "irls", (2000, 16, 3), (40_000, 16, 3), 1.5),
            scaling(huber, "irls", (5000, 16, 3), (1000, 160, 3), 1.5),
            scaling(huber, "irls", (5000, 24, 3), (5000, 24, 6), 12),
            scaling(lb.lts, "lts", (20, 40, 3), (20, 160, 3), 1.5),
            scaling(lb.lts, "lts", (20, 40, 3), (200, 40, 3), 1.5),
            *(robustat(Lts, lb.lts, "lts", n) for n in (8, 12, 16, 24, 40)),
            *(robustat(MMEstimator, lb.mm, "mm", n) for n in (8, 12, 16, 24, 40)),
            long_system(),
            memory(),
        ],
    )
