"""Aided centroids of 1000 images with 8 stars each, beside the paper's algorithm written down star
by star.
"""

import tracemalloc

from side_by_side import faster, in_turn, one_thread, report, within

one_thread()

import numpy as np  # noqa: E402
from scipy.special import erf  # noqa: E402

import losbench as lb  # noqa: E402

IMAGES, STARS, LOOPED, SIDE, MEGABYTES = 1000, 8, 20, 13, 1000
SIGMA, EXPOSURE_S, THRESHOLD, TOLERANCE = 0.45, 0.025, 0.02, 1e-5
CAMERA = lb.Camera(focal_mm=2.56 / np.tan(np.radians(4.0)), pixel_um=10.0, shape=(512, 512))
FOCAL_PX, MIDDLE = CAMERA.focal_mm / CAMERA.pixel_mm, 255.5
NOISE = lb.Detector(read_noise_e=1.0)


def scene():
    """Windows (images, stars, h, w) of smeared stars, their origins, and the gyro's paths."""
    shakes = lb.random_vibration(IMAGES, 1, max_rate_rad_s=np.radians(3.0))
    truth = lb.motion_path(shakes, EXPOSURE_S, nodes=2)
    tracks = truth.tracks(np.random.default_rng(2).uniform(20, 490, (IMAGES, STARS, 2)), CAMERA)
    origin = np.rint((tracks.max(axis=-2) + tracks.min(axis=-2)) / 2) - SIDE // 2
    windows = lb.render_streaks(
        tracks[..., None, :, :], truth.share, 1e4, SIGMA, (SIDE, SIDE), origin
    )
    path = lb.gyro_path(
        lb.Gyro().increments(shakes, EXPOSURE_S), interval_s=0.005, exposure_s=EXPOSURE_S
    )
    return windows, origin, path


def centre(image, origin):
    total = image.sum()
    pixel = np.arange(SIDE)
    return np.array([image.sum(axis=0) @ pixel, image.sum(axis=1) @ pixel]) / total + origin


def one_star(window, origin, turns, share, end, masked, whole_path):
    """lyu2015, section 1.3, for one star; nodes one by one, or at once as ``whole_path``."""
    mask = window > THRESHOLD * window.sum() if masked else np.ones_like(window, dtype=bool)
    measured = centre(np.where(mask, window, 0.0), origin)
    edges, scale = np.arange(SIDE + 1) - 0.5, 1 / (np.sqrt(2) * SIGMA)
    p = measured.copy()
    for _ in range(100):
        ray = np.array([*((p - MIDDLE) / FOCAL_PX), 1.0])
        if whole_path:
            rays = turns @ ray
            x, y = (FOCAL_PX * rays[:, k] / rays[:, 2] + MIDDLE - origin[k] for k in (0, 1))
            across, down = (np.diff(erf((edges - u[:, None]) * scale)) / 2 for u in (x, y))
            model = (down * share[:, None]).T @ across
        else:
            model = np.zeros_like(window)
            for turn, part in zip(turns, share, strict=True):
                seen = turn @ ray
                x, y = FOCAL_PX * seen[:2] / seen[2] + MIDDLE - origin
                across, down = (np.diff(erf((edges - u) * scale)) / 2 for u in (x, y))
                model += part * np.outer(down, across)
        step = measured - centre(np.where(mask, model, 0.0), origin)
        p += step
        if np.abs(step).max() < TOLERANCE:
            break
    seen = end @ np.array([*((p - MIDDLE) / FOCAL_PX), 1.0])
    return FOCAL_PX * seen[:2] / seen[2] + MIDDLE


def loop(windows, origin, path, masked, whole_path):
    return np.array(
        [
            [
                one_star(w, o, path.turns[k], path.share, path.epochs[k, 2], masked, whole_path)
                for w, o in zip(windows[k], origin[k], strict=True)
            ]
            for k in range(LOOPED)
        ]
    )


def ours(windows, origin, path, **choices):
    options = {"background": 0.0, "noise": NOISE} | choices
    return lb.aided_centroid(
        windows, origin=origin, path=path, camera=CAMERA, width=SIGMA, **options
    ).xy


def peak_megabytes(call):
    """Memory above that of the input."""
    tracemalloc.start()
    call()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / 1e6


if __name__ == "__main__":
    given = scene()
    count = IMAGES * STARS
    rows = []
    for masked, plain_target, whole_target in ((True, 20, 2), (False, 40, 4)):
        choices = {"threshold": THRESHOLD} if masked else {}
        name = "iterative, masked" if masked else "iterative"
        for whole, target, peer in (
            (False, plain_target, "a loop over stars, rounds and nodes"),
            (True, whole_target, "a loop over stars and rounds"),
        ):
            found, expected = ours(*given, **choices)[:LOOPED], loop(*given, masked, whole)
            np.testing.assert_allclose(found, expected, atol=1e-4)
            fast, slow = in_turn(
                lambda c=choices: ours(*given, **c),
                lambda m=masked, w=whole: loop(*given, m, w),
                rounds=3,
            )
            rows.append(faster(name, fast / count, peer, slow / (LOOPED * STARS), target))
    closed, iterative = in_turn(
        lambda: ours(*given, method="closed_form"), lambda: ours(*given), rounds=5
    )
    rows.append(faster("closed form", closed / count, "iterative", iterative / count, 20))
    least, iterative = in_turn(
        lambda: ours(*given, method="least_squares"), lambda: ours(*given), rounds=3
    )
    rows.append(within("least squares", least / count, "iterative", iterative / count, 8))
    used = max(
        peak_megabytes(lambda m=m: ours(*given, method=m)) for m in ("iterative", "least_squares")
    )
    print(f"memory above the input {used:.0f} MB, at most {MEGABYTES}")
    if used > MEGABYTES:
        raise SystemExit("memory: MISSED")
    report("inertial", rows)
