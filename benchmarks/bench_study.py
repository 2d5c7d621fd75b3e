"""Studies: the Monte Carlo of liu2026's Fig. 1 beside its random numbers, memory and quantiles for
1e5 to 1e7 trials, and cost against size.
"""

import resource
import subprocess
import sys

import numpy as np
from bench_montecarlo import DESIGN, PRECISION_MM, SEED, SHIFTS_MM, TRIALS, draw, solve
from records import growth
from side_by_side import at_once, in_turn, one_thread, report, within

import losbench as lb

SIZES, MOST_MB, CLOSE = (100_000, 1_000_000, 10_000_000), 20.0, 2e-3
HALF_A_MINUTE = 7_000_000  # trials by IRLS, about
EIGHT_ROWS = np.random.default_rng(1).standard_normal((8, 3))
PROBABILITIES = (0.00135, 0.02275, 0.15865, 0.5, 0.84135, 0.97725, 0.99865)


def throw(rng, size):
    return {"x": 1e5 + 50.0 * rng.standard_normal((size, 3))}


def robust_fig_1(rng, size):
    noise = PRECISION_MM * rng.standard_normal((size, 3, 4))
    return {"angles": lb.irls(DESIGN, SHIFTS_MM + noise).x}


def robust(rng, size):
    return {"x": lb.irls(EIGHT_ROWS, rng.standard_normal((size, 8)), on_fail="ignore").x}


def close(size: int) -> float:
    """Return how far quantiles of a study are from those of all its trials, in sigma."""
    drawn = lb.monte_carlo(throw, size, seed=SEED, chunk=10_000)["x"]
    found = lb.study(throw, {}, size, seed=SEED).summaries[0].quantiles(list(PROBABILITIES))
    return float(np.abs(found - np.quantile(drawn, PROBABILITIES, axis=0).T).max() / 50.0)


def held_mb(size: int) -> float:
    done = subprocess.run(
        [sys.executable, __file__, "--run", str(size)], check=True, capture_output=True, text=True
    )
    return float(done.stdout)


def main() -> None:
    ours, alone = in_turn(lambda: lb.study(solve, {}, TRIALS, seed=SEED), draw, rounds=200)
    rows = [within("Fig. 1 as a study", ours, "its random numbers alone", alone, 5)]
    ours, alone = in_turn(lambda: solve(np.random.default_rng(SEED), TRIALS), draw, rounds=200)
    rows.append(within("Fig. 1, one chunk of it", ours, "its random numbers alone", alone, 3))
    ours, alone = in_turn(
        lambda: robust_fig_1(np.random.default_rng(SEED), TRIALS), draw, rounds=200
    )
    rows.append(
        within("Fig. 1 by IRLS, one chunk of it", ours, "its random numbers alone", alone, 5)
    )
    held = {size: held_mb(size) for size in SIZES}
    apart, off = max(held.values()) - min(held.values()), close(400_000)
    told = ", ".join(f"{size:g}: {mb:.0f} MB" for size, mb in held.items())
    print(f"{told}; quantiles off by {off:.1e} sigma at most")
    more = [
        *at_once(
            f"{HALF_A_MINUTE} robust trials",
            lambda pool: lb.study(robust, {}, HALF_A_MINUTE, seed=SEED, executor=pool),
        ),
        {
            "what": f"memory of {told}",
            "target": f"within {MOST_MB:g} MB",
            "verdict": "ok" if apart <= MOST_MB else "MISSED",
        },
        {
            "what": f"quantiles from 0.135 % to 99.865 %: {off:.1e} sigma off at most",
            "target": f"at most {CLOSE:g} sigma",
            "verdict": "ok" if off <= CLOSE else "MISSED",
        },
    ]

    def least(size):
        y = np.random.default_rng(2).standard_normal((size, 8))
        return lambda: lb.lstsq(EIGHT_ROWS, y)

    def fits(size):
        y = np.random.default_rng(2).standard_normal((size, 8))
        return lambda: lb.irls(EIGHT_ROWS, y, on_fail="ignore")

    growths = [
        growth("study of Fig. 1", "trials", (1000, 10_000, 100_000, 1_000_000), of_size),
        growth("lstsq of 8 x 3", "systems", (100, 1000, 10_000, 100_000), least),
        growth("irls of 8 x 3", "systems", (100, 1000, 10_000, 100_000), fits),
    ]
    report("study", rows, more=more, growths=growths)


def of_size(size):
    return lambda: lb.study(solve, {}, size, seed=SEED)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--run"]:
        lb.study(throw, {}, int(sys.argv[2]), seed=SEED)
        print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3)
    else:
        one_thread()
        main()
