"""Damaged files at every door: what comes out is a result, or one documented line.

``python benchmarks/fuzz.py`` tries all doors, ``python benchmarks/fuzz.py tiff --cases 10000`` one.
Doors come from the files ``fuzz_*.py`` beside this one: each has ``DOORS``, from a name to a pair,
what makes whole files, and what reads one path. Every case follows from the seed and its number; it
runs in a process that may hold 500 MB, and has five seconds.
"""

import argparse
import importlib
import json
import resource
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
CASES, SEED = 10_000, 20_261
MOST_MB, MOST_S = 500, 5
BATCH = 500  # cases of one process


def doors():
    sys.path.insert(0, str(HERE))
    found = {}
    for path in sorted(HERE.glob("fuzz_*.py")):
        found |= importlib.import_module(path.stem).DOORS
    return found


def damaged(whole, rng):
    """Return bytes with one to four kinds of damage, half of them where headers stand."""
    data = bytearray(whole)
    text = whole.isascii()
    for _ in range(rng.integers(1, 5)):
        if not data:
            break
        ends = rng.random() < 0.5
        near = min(len(data), 400)
        at = int(rng.integers(near)) if ends else int(rng.integers(len(data)))
        if ends and rng.random() < 0.3:
            at = len(data) - 1 - at
        n = int(min(rng.integers(1, 60), len(data) - at))
        kind = rng.choice([3, 4, 5, 7, 7, 7]) if text else rng.integers(7)
        if kind == 0:
            data[at] ^= 1 << int(rng.integers(8))
        elif kind == 1:
            data[at : at + n] = bytes(n)
        elif kind == 2:
            data[at : at + n] = rng.bytes(n)
        elif kind == 3:
            del data[at:]
        elif kind == 4:
            del data[at : at + n]
        elif kind == 5:
            data[at:at] = data[at : at + n]
        elif kind == 7:
            data[at] = int(rng.choice(list(b"0123456789.,;:-+eE\"'[]= \tTZ#\n")))
        else:
            value = int(rng.choice([0, 1, 2**15 - 1, 2**16 - 1, 2**31 - 1, 2**32 - 1, 2**63 - 1]))
            form = rng.choice(["little", "big"])
            size = int(rng.choice([s for s in (2, 4, 8) if value < 2 ** (8 * s)]))
            data[at : at + size] = value.to_bytes(size, form)
    return bytes(data)


def judged(read, path):
    """Return "read", a documented refusal, or what is wrong with the outcome."""
    begin = time.perf_counter()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            read(path)
        outcome = "read"
    except (ValueError, FileNotFoundError) as error:
        last = traceback.extract_tb(error.__traceback__)[-1].filename
        said = str(error)
        if "losbench" not in Path(last).parts:
            outcome = f"undocumented {type(error).__name__} of {Path(last).name}: {said[:80]}"
        elif "\n" in said or len(said) > 600:
            outcome = f"more than a line: {said[:80]!r}"
        else:
            outcome = f"refused: {type(error).__name__}"
    except Exception as error:
        outcome = f"undocumented {type(error).__name__}: {str(error)[:80]}"
    took = time.perf_counter() - begin
    return f"slow: {took:.1f} s" if took > MOST_S else outcome


def worker(door, first, last, seed):
    make, read = doors()[door]
    whole, beside = make()
    names = sorted(whole)
    with tempfile.TemporaryDirectory() as folder:
        for name, content in beside.items():
            Path(folder, name).write_bytes(content)
        for name in names:  # whole ones are read, and imports are not counted
            path = Path(folder, f"whole-{name}")
            path.write_bytes(whole[name])
            if (outcome := judged(read, path)) != "read" and not outcome.startswith("slow"):
                raise SystemExit(f"{name} should be read: {outcome}")
        for case in range(first, last):
            print(json.dumps([case, "began"]), flush=True)
            rng = np.random.default_rng([seed, case])
            name = names[case % len(names)]
            path = Path(folder, f"{case}-{name}")  # handles are kept by path
            path.write_bytes(damaged(whole[name], rng))
            signal.alarm(4 * MOST_S)  # the end of what never ends
            outcome = judged(read, path)
            signal.alarm(0)
            path.unlink()
            held = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
            print(json.dumps([case, outcome, held]), flush=True)


def attack(door, cases, seed):
    """Try one door; return how outcomes are shared, the cases that are wrong, and the most memory."""
    outcomes, wrong, most, first = Counter(), {}, 0.0, 0
    while first < cases:
        last = min(first + BATCH, cases)
        command = [
            sys.executable,
            __file__,
            door,
            "--seed",
            str(seed),
            "--range",
            str(first),
            str(last),
        ]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        lines = [json.loads(line) for line in done.stdout.splitlines()]
        began = max((line[0] for line in lines), default=first)
        for line in lines:
            if len(line) == 3:
                case, outcome, held = line
                if held > MOST_MB >= most:
                    outcome = f"{held:.0f} MB"
                most = max(most, held)
                outcomes[outcome.split(":")[0]] += 1
                if outcome != "read" and not outcome.startswith("refused"):
                    wrong[case] = outcome
        if done.returncode == 0:
            first = last
        else:
            said = done.stderr.strip().splitlines()[-1:] or [""]
            wrong[began] = f"the process ended with {done.returncode}: {said[0][:120]}"
            outcomes["ended"] += 1
            first = began + 1
    return outcomes, wrong, most


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("doors", nargs="*", help="default all")
    parser.add_argument("--cases", type=int, default=CASES, help="for each door (%(default)s)")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--range", type=int, nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--keep", type=Path, help="folder for the files that went wrong")
    options = parser.parse_args()
    if options.range:
        worker(options.doors[0], *options.range, options.seed)
        return 0
    failed = False
    for door in options.doors or doors():
        begin = time.perf_counter()
        outcomes, wrong, most = attack(door, options.cases, options.seed)
        failed |= bool(wrong)
        shares = ", ".join(f"{count} {what}" for what, count in outcomes.most_common())
        took = time.perf_counter() - begin
        print(f"{door}: {options.cases} cases in {took:.0f} s, {most:.0f} MB: {shares}", flush=True)
        for case, what in list(wrong.items())[:20]:
            print(f"  case {case}: {what}")
        if options.keep and wrong:
            whole, _ = doors()[door][0]()
            options.keep.mkdir(parents=True, exist_ok=True)
            for case in wrong:
                name = sorted(whole)[case % len(whole)]
                rng = np.random.default_rng([options.seed, case])
                (options.keep / f"{door}-{case}-{name}").write_bytes(damaged(whole[name], rng))
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
