"""What every bench has found, kept in build/benchmarks, one file a bench, for `page.py` to show.

A row is one comparison: what was done, beside a peer or a physical limit, and what was wanted. A
growth is the cost of one thing against its size.
"""

from __future__ import annotations

import json
import os
import platform
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).resolve().parent.parent / "build" / "benchmarks"
_ROUNDS, _LONG_S = 3, 1.0


def record(
    name: str, rows: Iterable[Mapping[str, Any]] = (), growths: Iterable[Mapping[str, Any]] = ()
) -> None:
    """Keep what a bench has found; another record of that name takes its place."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    about = {
        "name": name,
        "when": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "machine": f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}",
        "load": load,
    }
    found = {**about, "rows": [dict(row) for row in rows], "growths": [dict(g) for g in growths]}
    (FOLDER / f"{name}.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


def growth(
    what: str, unit: str, sizes: Sequence[int], prepared: Callable[[int], Callable[[], object]]
) -> dict[str, Any]:
    """Shortest processor time of ``prepared(size)()`` for each size; long ones are timed once."""
    seconds = []
    for size in sizes:
        call, best = prepared(size), float("inf")
        for _ in range(_ROUNDS):
            start = time.process_time()
            call()
            best = min(best, time.process_time() - start)
            if best > _LONG_S:
                break
        seconds.append(best)
    each = ", ".join(
        f"{size:g}: {1e6 * s / size:.3g}" for size, s in zip(sizes, seconds, strict=True)
    )
    print(f"{what}: us for each of so many {unit}: {each}")
    return {"what": what, "unit": unit, "sizes": list(sizes), "seconds": seconds}
