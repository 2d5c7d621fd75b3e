"""One look for all figures, and saving with provenance.

Every saved figure has a side-car JSON that says what it shows, from which parameters and seed, and
with which versions it was made; saved twice from one tree it is the same to the byte.
"""

from __future__ import annotations

import hashlib
import io
import json
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING

import matplotlib as mpl
import matplotlib.pyplot as plt
from matplotlib.figure import Figure
from matplotlib.rcsetup import cycler

from losbench.made import plain, versions
from losbench.resources import build_folder, notebook_folder, write_whole

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["COLOURS", "commit", "png", "save", "save_table", "styled", "use_style"]

# Okabe and Ito's palette, told apart by colour-blind readers; black first, yellow left out as too
# pale for a line.
COLOURS = {
    "black": "#000000",
    "blue": "#0072B2",
    "vermilion": "#D55E00",
    "green": "#009E73",
    "purple": "#CC79A7",
    "orange": "#E69F00",
    "sky": "#56B4E9",
}

_STYLE = {
    "axes.prop_cycle": cycler(
        color=[COLOURS[c] for c in COLOURS if c != "black"] + [COLOURS["black"]]
    ),
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 11,
    "axes.titlelocation": "left",
    "axes.labelsize": 11,
    "font.size": 10.5,
    "grid.color": "#E3E3E3",
    "grid.linewidth": 0.8,
    "image.cmap": "viridis",
    "image.origin": "upper",
    "image.interpolation": "nearest",
    "legend.frameon": False,
    "lines.linewidth": 1.4,
    "figure.figsize": (7.0, 4.2),
    "figure.constrained_layout.use": True,
    "savefig.dpi": 150,
    "svg.fonttype": "path",
}


def use_style() -> None:
    """Set matplotlib to the style of these notebooks, whatever the user's own settings are."""
    plt.style.use(["default", _STYLE])


@contextmanager
def styled() -> Iterator[None]:
    """Use the style of `use_style` for a while, and leave the user's own as it was."""
    with mpl.rc_context():
        use_style()
        yield


def png(fig: Figure) -> bytes:
    """Return a figure as the bytes of a PNG file."""
    buffer = io.BytesIO()
    fig.savefig(buffer, format="png")
    return buffer.getvalue()


def save(fig: Figure, name: str, *, parameters: object = None, seed: int | None = None) -> None:
    """Save a figure as ``build/figures/<name>.png`` and ``.svg``, with its provenance in
    ``<name>.json``.

    Parameters
    ----------
    fig : Figure
        Any matplotlib figure.
    name : str
        Paper and figure, e.g. "liu2026-fig-1".
    parameters : dataclass or mapping, optional
        What the figure was computed from.
    seed : int, optional
        Seed of its random numbers.
    """
    paper, _, figure = name.partition("-")
    record = {
        "paper": paper,
        "figure": figure,
        "parameters": plain(parameters),
        "seed": seed,
        "versions": versions(),
        "commit": commit(),
    }
    metadata = {
        "Title": name,
        "Description": json.dumps(record, sort_keys=True),
        "Software": "losbench",
    }
    files = {
        "png": _drawn(fig, "png", name, metadata),
        "svg": _drawn(fig, "svg", name, {"Title": name, "Date": None, "Creator": "losbench"}),
    }
    folder = build_folder() / "figures"
    for kind, content in files.items():
        write_whole(folder / f"{name}.{kind}", content)
    record["sha256"] = {
        kind: hashlib.sha256(content).hexdigest() for kind, content in files.items()
    }
    write_whole(folder / f"{name}.json", json.dumps(record, indent=1, sort_keys=True) + "\n")


def save_table(frame: pd.DataFrame, name: str) -> None:
    """Save a table as ``build/tables/<name>.csv``, floats to six digits; an index is kept if it has
    a name.
    """
    named = any(level is not None for level in frame.index.names)
    text = frame.to_csv(index=named, float_format="%.6g", lineterminator="\n")
    write_whole(build_folder() / "tables" / f"{name}.csv", text)


@cache
def commit() -> str:
    """Return the commit of the checkout that runs, "-dirty" added where it was changed, or
    "unknown".
    """
    root = notebook_folder().parent
    if not (root / ".git").exists():
        return "unknown"
    describe = [
        "git",
        "-C",
        str(root),
        "describe",
        "--always",
        "--dirty",
        "--abbrev=40",
        "--exclude=*",
    ]
    try:
        return subprocess.run(
            describe, capture_output=True, text=True, check=True, timeout=20
        ).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return "unknown"


def _drawn(fig: Figure, kind: str, name: str, metadata: Mapping[str, str | None]) -> bytes:
    buffer = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": name}):
        fig.savefig(buffer, format=kind, metadata=metadata)
    return buffer.getvalue()
