"""Centroids and finding beside a plain loop, peers and the physical limit, all in one run.

Ratios of times on the same spots and frames; ``--save`` writes them to
benchmarks/baselines/centroid.csv. Peers that are not installed (``pip install sep photutils``) are
left out with a line, and picassosr, which wants pandas below 3, unless LOSBENCH_PICASSO names the
python of an environment that has it. One thread: set OMP_NUM_THREADS=1.
"""

from __future__ import annotations

import argparse
import csv
import importlib.util
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

import losbench as lb

BASELINE = Path(__file__).parent / "baselines" / "centroid.csv"
FRAMES, SIGMA, WINDOW, SIZE = 1000, 2.5, 15, 33
CAMERA = lb.Detector(gain_e_per_dn=2.0, read_noise_e=5.0, offset_dn=100.0)


def naive_eiwa(image, start, window, *, tolerance=1e-3, max_iter=50):
    """EIWA of one spot as one would write it down: ring plane in two clipped passes, then the
    moving window.
    """
    half = window // 2
    column, row = np.rint(start).astype(int)
    y, x = np.mgrid[row - half - 4 : row + half + 5, column - half - 4 : column + half + 5]
    pixels = image[y, x].astype(float)
    plane = _naive_plane(pixels, x - column, y - row, half)
    near = (slice(3, -3), slice(3, -3))
    x, y = x[near], y[near]
    signal = pixels[near] - (plane[0] + plane[1] * (x - column) + plane[2] * (y - row))

    centre = np.array(start, dtype=float)
    for k in range(max_iter):
        wx = np.clip((window + 1) / 2 - np.abs(x[0] - centre[0]), 0, 1)
        wy = np.clip((window + 1) / 2 - np.abs(y[:, 0] - centre[1]), 0, 1)
        weighted = signal * wx * wy[:, None]
        total = weighted.sum()
        centroid = np.array([(weighted * x).sum(), (weighted * y).sum()]) / total
        step = centroid - centre
        contraction = np.empty(2)
        for axis, (sums, first) in enumerate(((wy @ signal, x[0, 0]), (signal @ wx, y[0, 0]))):
            left = int(np.floor(centre[axis] - window / 2 + 0.5))
            right = left + window
            pull = (right - centroid[axis]) * sums[right - first] + (centroid[axis] - left) * sums[
                left - first
            ]
            contraction[axis] = pull / total
        ahead = step / np.maximum(1 - contraction, 0.15)
        centre += np.clip(np.where((k > 0) & (abs(contraction) < 0.85), ahead, step), -1, 1)
        if np.hypot(*ahead) < tolerance:
            break
    return centre


def _naive_plane(pixels, x, y, half):
    in_ring = np.maximum(abs(x), abs(y)) > half
    value, x, y = pixels[in_ring], x[in_ring], y[in_ring]
    basis = np.column_stack([np.ones(len(value)), x, y])
    plane, *_ = np.linalg.lstsq(basis, value, rcond=None)
    residual = value - basis @ plane
    scatter = np.sqrt((residual**2).sum() / (len(value) - 3))
    if abs(residual).max() <= 3.5 * scatter and abs((residual**3).mean()) <= 0.6 * scatter**3:
        return plane
    few = value[::4]
    middle = np.sort(few)[len(few) // 2]
    deviation = np.abs(few - middle)
    scatter = max(1.4826 * np.sort(deviation)[len(few) // 2], deviation.mean() / 3)
    residual = value - middle
    for _ in range(2):
        keep = np.abs(residual) <= 3 * scatter
        plane, *_ = np.linalg.lstsq(basis[keep], value[keep], rcond=None)
        residual = value - basis @ plane
        scatter = np.sqrt((residual[keep] ** 2).sum() / (keep.sum() - 3) / 0.9733)
    return plane


def two_spots(frames, seed=0, size=SIZE, sigma=SIGMA):
    """Stamps of two spots per frame side by side, and where the spots are: (F, size, 2 size), (F,
    2, 2).
    """
    rng = np.random.default_rng(seed)
    xy = np.array([[size // 2, size // 2], [size + size // 2, size // 2]]) + rng.uniform(
        -0.4, 0.4, (frames, 2, 2)
    )
    return CAMERA.expose(lb.render_spots(xy, 5e4, sigma, (size, 2 * size)) + 100.0, rng), xy


def in_turns(calls, rounds):
    """Processor time of each call, s: the best fifth of rounds in which all take turns, so that
    other load strikes all alike.
    """
    taken = {name: [] for name in calls}
    for turn in range(rounds):
        for name, call in calls.items():
            begin = time.process_time()
            call(turn)
            taken[name].append(time.process_time() - begin)
    return {name: float(np.percentile(times, 20)) for name, times in taken.items()}


def measure_rows():
    """Rows of centroiding: (what, ratio, target, detail)."""
    frames, xy = two_spots(FRAMES)
    start = np.rint(xy)
    few = 50
    images = [np.ascontiguousarray(f, dtype=np.float32) for f in frames[:few]]
    flat = [image - np.median(image) for image in images]

    def plain(_):
        return [
            naive_eiwa(image, p, WINDOW)
            for image, ps in zip(frames[:few], start, strict=False)
            for p in ps
        ]

    template = {"method": "weighted", "window": WINDOW, "sigma": SIGMA, "noise": CAMERA}
    calls = {
        "eiwa": lambda _: lb.centroid(frames, start, window=WINDOW),
        "weighted": lambda _: lb.centroid(frames, start, **template),
        "plain": plain,
    }
    peers = [("eiwa", "plain", "plain loop", 6.0)]
    if importlib.util.find_spec("sep"):
        import sep

        def winpos(subpix, images=flat):
            width = np.full(2, SIGMA)
            return [
                sep.winpos(image, p[:, 0], p[:, 1], width, subpix=subpix)[:2]
                for image, p in zip(images, start, strict=False)
            ]

        calls |= {"sep": lambda _: winpos(11)}
        peers += [("eiwa", "sep", "sep.winpos", 3.0), ("weighted", "sep", "sep.winpos", 3.0)]
        every = [
            np.ascontiguousarray(frame, dtype=np.float32) - np.median(frame) for frame in frames
        ]
        own = lb.centroid(frames, start, **template).xy - xy
        other = np.swapaxes(winpos(11, every), 1, 2) - xy
        errors = [1e3 * float(np.sqrt(np.mean(error**2))) for error in (other, own)]
        detail = f"{errors[0]:.2f} / {errors[1]:.2f} millipixel"
        yield "weighted: error of sep.winpos / its own", errors[0] / errors[1], 1.0, detail
    else:
        print("sep is not installed: its rows are left out")
    if importlib.util.find_spec("photutils"):
        from photutils.centroids import centroid_2dg, centroid_com, centroid_sources

        def sources(function):
            for image, p in zip(flat, start, strict=False):
                centroid_sources(image, p[:, 0], p[:, 1], box_size=WINDOW, centroid_func=function)

        calls |= {"com": lambda _: sources(centroid_com), "2dg": lambda _: sources(centroid_2dg)}
        peers += [("eiwa", "com", "photutils centroid_sources(com)", 1.0)]
        peers += [("weighted", "2dg", "photutils centroid_2dg", 80.0)]
    else:
        print("photutils is not installed: its row is left out")

    taken = in_turns(calls, 15)
    for method, name, what, target in peers:
        own, other = taken[method] / (2 * FRAMES), taken[name] / (2 * few)
        yield (
            f"{method}: {what} / batch",
            other / own,
            target,
            f"{1e6 * other:.1f} / {1e6 * own:.1f} us per spot",
        )


def field(frames, count, seed=0, sigma=2.0, cell=40):
    """Frames (F, H, W) of spots on a jittered lattice, and where they are (F, n, 2)."""
    rng = np.random.default_rng(seed)
    across = int(np.ceil(np.sqrt(count)))
    row, column = np.divmod(np.arange(count), across)
    corner = np.stack([column, row], axis=-1) * cell
    xy = corner + cell / 2 + rng.uniform(-0.5, 0.5, (frames, count, 2))
    light = np.zeros((frames, (row.max() + 1) * cell, across * cell))
    for k, (x, y) in enumerate(corner):
        place = xy[:, k : k + 1]
        light[:, y : y + cell, x : x + cell] = lb.render_spots(
            place, 2e4, sigma, (cell, cell), origin=(x, y)
        )
    return CAMERA.expose(light + 100.0, rng), xy


def shape_rows():
    """Rows of one frame with many spots, and of many with few: all flags on, beside sep."""
    import sep

    width = 2.0
    for frames, count in ((1, 800), (1, 100), (20, 40), (1000, 2)):
        stack, xy = field(frames, count)
        start, sigma = np.rint(xy), np.full(count, width)
        raw = [np.ascontiguousarray(frame, dtype=np.float32) for frame in stack]
        flat = [image - np.median(image) for image in raw]

        def winpos(images, start=start, sigma=sigma):
            for image, p in zip(images, start, strict=True):
                sep.winpos(image, p[:, 0], p[:, 1], sigma, subpix=1)

        def with_background(images, winpos=winpos):
            winpos([image - sep.Background(image).back() for image in images])

        kinds = {
            "given": lb.Weighted(width, window=13),
            "found": lb.Weighted(window=13),
            "eiwa": lb.EIWA(13),
            "likely": lb.Likelihood(width, window=13),
        }
        calls = {
            name: lambda _, s=stack, p=start, m=method: lb.centroid(s, p, method=m, detector=CAMERA)
            for name, method in kinds.items()
        }
        calls |= {
            "sep": lambda _, flat=flat, winpos=winpos: winpos(flat),
            "back": lambda _, raw=raw, call=with_background: call(raw),
        }
        taken = {k: 1e6 * t / (frames * count) for k, t in in_turns(calls, 9).items()}
        what, sep1 = f"{frames} x {count}", taken["sep"]
        detail = f"{taken['given']:.1f} / {sep1:.1f} us per spot"
        highest = {800: 1.6, 2: 1.0}.get(count, 4.0)
        yield f"{what}: weighted / sep.winpos(subpix=1)", taken["given"] / sep1, -highest, detail
        if frames == 1 and count == 800:
            detail = f"{taken['found']:.1f} / {sep1:.1f} us per spot"
            yield f"{what}: weighted, width found / same", taken["found"] / sep1, -2.2, detail
        detail = f"{taken['back']:.1f} / {taken['given']:.1f} us per spot"
        ratio = taken["back"] / taken["given"]
        yield f"{what}: sep.Background + winpos / weighted", ratio, 1.0, detail
        detail = f"{taken['likely']:.1f} / {taken['given']:.1f} us per spot"
        ratio = taken["likely"] / taken["given"]
        yield f"{what}: likelihood / weighted", ratio, -5.0, detail
        detail = f"{taken['eiwa']:.1f} / {sep1:.1f} us per spot"
        yield f"{what}: eiwa / sep.winpos(subpix=1)", taken["eiwa"] / sep1, -4.0, detail


def picasso_rows():
    """Rows of the likelihood beside the compiled fits of picassosr, in the environment whose python
    LOSBENCH_PICASSO names. It is given stamps in electrons; here they are cut, rings and flags too.
    """
    stack, xy = field(100, 40)
    start, side = np.rint(xy), 13
    corner = start.astype(int) - side // 2
    stamps = np.array(
        [
            image[y : y + side, x : x + side]
            for image, places in zip(stack, corner, strict=True)
            for x, y in places
        ]
    )
    photons = (stamps - CAMERA.offset_dn) * CAMERA.gain_e_per_dn
    with tempfile.TemporaryDirectory() as folder:
        given, fits = (Path(folder) / name for name in ("stamps.npz", "fits.npz"))
        np.savez(given, photons=photons, variance=CAMERA.read_noise_e**2)
        script = Path(__file__).parent / "picasso_fit.py"
        subprocess.run([os.environ["LOSBENCH_PICASSO"], script, given, fits], check=True)
        fit = dict(np.load(fits))
    method = lb.Likelihood(2.0, window=side)

    def own(_):
        return lb.centroid(stack, start, method=method, detector=CAMERA)

    taken = 1e6 * in_turns({"own": own}, 9)["own"] / len(stamps)
    error = float(np.sqrt(np.mean((own(0).xy - xy) ** 2)))
    for name, what in (("new", "picassosr, 0.11"), ("old", "picassosr, gaussmle")):
        off = fit[f"{name}_xy"].reshape(xy.shape) + start - xy
        other, spent = float(np.sqrt(np.mean(off**2))), 1e6 * float(fit[f"{name}_s"]) / len(stamps)
        detail = f"{spent:.1f} / {taken:.1f} us per spot"
        yield f"likelihood: {what} / its own", spent / taken, 1.0, detail
        detail = f"{1e3 * other:.2f} / {1e3 * error:.2f} millipixel"
        yield f"likelihood: error of {what} / its own", other / error, 0.98, detail


def find_rows():
    """Rows of finding, over a stack of frames that does not fit into a cache."""
    light = lb.render_spots([[400.3, 500.2], [1500.0, 600.0]], [6e4, 5e4], 3.5, (1080, 1920)) + 60.0
    frame = CAMERA.expose(light, 1)
    stack = np.stack([frame] * 60)
    level = float(np.median(frame) + 8 * 1.4826 * np.median(np.abs(frame - np.median(frame))))

    def components(image):
        _, mask = cv2.threshold(image, level, 255, cv2.THRESH_BINARY)
        return cv2.connectedComponentsWithStats(mask.astype(np.uint8))

    def over_the_stack(call):
        return lambda _: [call(image) for image in stack]

    calls = {"find": lb.find_spots, "components": components, "max": np.max}
    taken = in_turns({name: over_the_stack(call) for name, call in calls.items()}, 7)
    find, other, single = (taken[name] / len(stack) for name in ("find", "components", "max"))
    yield (
        "find: threshold + connected components / find_spots",
        other / find,
        8.0,
        f"find {1e3 * find:.2f} ms",
    )
    yield (
        "find: find_spots / np.max (passes)",
        find / single,
        -4.0,
        f"one pass {1e3 * single:.2f} ms",
    )


def crowd_rows():
    """Rows of finding in crowded frames and on a sky clipped at black, beside sep's background and
    extraction.
    """
    import sep

    def extract(image):
        back = sep.Background(image)
        return sep.extract(image - back.back(), 8.0, err=back.globalrms)

    for what, size, count, sky, rounds, at_least in (
        ("2000 x 2000, 2000 spots", (2000, 2000), 2000, 100.0, 7, 2.0),
        ("8192 x 8192, 10 000 spots", (8192, 8192), 10_000, 100.0, 2, 1.0),
        ("1040 x 1392, 5 spots, half of it black", (1040, 1392), 5, 0.0, 7, 2.0),
    ):
        rng = np.random.default_rng(count)
        xy = rng.uniform(8, np.array(size[::-1]) - 8, (count, 2))
        light = lb.render_spots(xy, 5e3 * rng.uniform(0.5, 2.0, count), 1.5, size)
        light += sky + 3.0 * rng.standard_normal(size, dtype=np.float32)
        image = light.round().clip(0).astype(np.uint16)
        real = image.astype(np.float32)
        taken = in_turns(
            {
                "find": lambda _, image=image: lb.find_spots(image),
                "sep": lambda _, real=real: extract(real),
            },
            rounds,
        )
        detail = f"{1e3 * taken['sep']:.1f} / {1e3 * taken['find']:.1f} ms"
        yield f"{what}: sep / find_spots", taken["sep"] / taken["find"], at_least, detail


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--save", action="store_true", help="write the table to benchmarks/baselines/centroid.csv"
    )
    save = parser.parse_args().save
    cv2.setNumThreads(1)
    table, missed = [], False
    beside_sep = (shape_rows, crowd_rows) if importlib.util.find_spec("sep") else ()
    beside_picasso = (picasso_rows,) if os.environ.get("LOSBENCH_PICASSO") else ()
    rows = (measure_rows, find_rows, *beside_sep, *beside_picasso)
    for what, ratio, target, detail in (row for some in rows for row in some()):
        # A negative target is a ceiling.
        ok = ratio <= -target if target < 0 else ratio >= target
        bound = f"{'<=' if target < 0 else '>='} {abs(target):g}"
        print(f"{what:56s} {ratio:8.2f}  target {bound:8s} {'ok' if ok else 'MISSED'}  {detail}")
        table.append([what, f"{ratio:.2f}", bound, detail])
        missed |= not ok
    if save:
        BASELINE.parent.mkdir(exist_ok=True)
        with BASELINE.open("w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows(
                [["what", "ratio", "target", "detail"], *table]
            )
    sys.exit(missed)


if __name__ == "__main__":
    main()
