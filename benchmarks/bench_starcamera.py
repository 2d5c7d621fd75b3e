"""A million attitudes of two heads through correction and angle, beside the Rotation operations
they consist of.
"""

import tracemalloc

from side_by_side import in_turn, one_thread, report, within

one_thread()

import numpy as np  # noqa: E402
from scipy.spatial.transform import Rotation  # noqa: E402

import losbench as lb  # noqa: E402

SAMPLES, MEGABYTES = 1_000_000, 500
CONVENTION = lb.QuaternionConvention(scalar="last", direction="camera_to_inertial")


def heads() -> tuple[np.ndarray, np.ndarray]:
    """Attitudes (2, n, 4) and drifts (2, n, 3)."""
    rng = np.random.default_rng(0)
    q = rng.standard_normal((2, SAMPLES, 4))
    return q / np.linalg.norm(q, axis=-1, keepdims=True), 1e-6 * rng.standard_normal(
        (2, SAMPLES, 3)
    )


def ours(q: np.ndarray, drift: np.ndarray) -> np.ndarray:
    corrected = [lb.correct_drift(q[k], drift[k], convention=CONVENTION) for k in range(2)]
    return lb.boresight_angle(*corrected, convention=CONVENTION)


def scipy_alone(q: np.ndarray, drift: np.ndarray) -> np.ndarray:
    """The same with nothing checked and nothing missing."""
    corrected = [
        (Rotation.from_quat(q[k]) * Rotation.from_rotvec(drift[k]).inv()).as_quat()
        for k in range(2)
    ]
    z1, z2 = (Rotation.from_quat(c).apply([0.0, 0.0, 1.0]) for c in corrected)
    return np.arctan2(np.linalg.norm(np.cross(z1, z2), axis=1), np.vecdot(z1, z2))


def peak_megabytes(call, *arguments) -> float:
    """Memory above that of the arguments."""
    tracemalloc.start()
    call(*arguments)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / 1e6


if __name__ == "__main__":
    q, drift = heads()
    np.testing.assert_allclose(ours(q, drift), scipy_alone(q, drift), atol=1e-13)
    ours_s, scipy_s = in_turn(lambda: ours(q, drift), lambda: scipy_alone(q, drift), rounds=5)
    used = peak_megabytes(ours, q, drift)
    print(f"memory above the input {used:.0f} MB, at most {MEGABYTES}")
    if used > MEGABYTES:
        raise SystemExit("memory: MISSED")
    report(
        "starcamera",
        [
            within(
                "correction and angle, one sample",
                ours_s / SAMPLES,
                "its Rotation operations",
                scipy_s / SAMPLES,
                1.5,
            )
        ],
    )
