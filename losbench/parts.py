"""Folders of parts: what a long run has done so far, so that a killed one goes on where it was.

A part is an .npz file that stands whole or not at all; its checksums find damage. ``run.json`` says
what the parts belong to, so that no run goes on with those of another.
"""

from __future__ import annotations

import io
import json
import os
import tempfile
import textwrap
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from losbench.__about__ import __version__
from losbench.outputs import locked

__all__ = ["Parts", "kept_parts"]

_RUN = "run.json"
_DRAFT = ".losbench-draft-"  # no file of anybody else
_NAME = "_part"


@dataclass(frozen=True)
class Parts:
    """The parts of one run, by name; without a folder nothing is kept."""

    folder: Path | None = None

    def read(self, name: str) -> dict[str, NDArray[Any]] | None:
        """Return the arrays of a part, or None if it is not there or damaged."""
        if self.folder is None:
            return None
        # A flipped bit may show as anything that zipfile, zlib or NumPy can raise.
        try:
            data = io.BytesIO((self.folder / f"{name}.npz").read_bytes())
            with np.load(data, allow_pickle=False) as part:
                held = dict(part)
            return held if str(held.pop(_NAME)) == name else None
        except Exception:
            return None

    def write(self, name: str, arrays: Mapping[str, ArrayLike]) -> None:
        """Keep a part.

        Raises
        ------
        OSError
            With the part's name, and that those before it stay.
        """
        if self.folder is None:
            return
        with _drafted(self.folder, f"{name}.npz") as draft:
            # With its name: one that was copied into another's place is no part of the run.
            np.savez_compressed(draft, allow_pickle=False, **arrays, **{_NAME: np.array(name)})


@contextmanager
def kept_parts(
    out: str | Path | None, recipe: Mapping[str, Any], *, resume: bool = False
) -> Iterator[Parts]:
    """Open the folder of a run's parts, for this run alone.

    Parameters
    ----------
    out : path or None
        The folder; None keeps nothing.
    recipe : mapping
        What the parts depend on, as JSON can hold it.
    resume : bool
        Go on with the parts of an earlier run, if there are any.

    Raises
    ------
    FileExistsError
        If the folder holds anything else, or a run and ``resume`` is not set.
    BlockingIOError
        If another run writes to it.
    ValueError
        If it holds parts of a run of another recipe, which is told.

    Examples
    --------
    >>> with tempfile.TemporaryDirectory() as parent:
    ...     with kept_parts(parent + "/out", {"window": 13}) as parts:
    ...         parts.write("part-0", {"x": [1.0, 2.0]})
    ...         parts.read("part-0")["x"].tolist(), parts.read("part-1")
    ([1.0, 2.0], None)
    """
    if out is None:
        if resume:
            raise ValueError("resume needs out, the folder of the run to go on with")
        yield Parts()
        return
    folder = Path(os.path.realpath(out))  # one lock, by whatever link it is reached
    if folder.exists() and not folder.is_dir():
        raise FileExistsError(f"{out} must be a folder, but is a file")
    wanted = json.loads(json.dumps({**recipe, "losbench": __version__}))
    with locked(folder):
        folder.mkdir(parents=True, exist_ok=True)
        for draft in folder.glob(f"{_DRAFT}*"):  # of a run that was killed
            draft.unlink()
        if (folder / _RUN).exists():
            if not resume:
                raise FileExistsError(
                    f"{out} holds a run: resume it (resume=True, --resume), or choose another "
                    "folder"
                )
            _check_same(folder, wanted)
        elif any(folder.iterdir()):
            raise FileExistsError(f"{out} is not empty, and holds no run to resume")
        else:
            with _drafted(folder, _RUN) as draft:
                draft.write(json.dumps(wanted, indent=1).encode() + b"\n")
        yield Parts(folder)


def _check_same(folder: Path, wanted: dict[str, Any]) -> None:
    try:
        before = dict(json.loads((folder / _RUN).read_text(encoding="utf-8")))
    except (ValueError, TypeError, RecursionError):
        raise ValueError(f"{folder / _RUN} is damaged: choose another folder") from None
    changed = [
        f"{name} was {_short(before.get(name))}, is {_short(wanted.get(name))}"
        for name in {**before, **wanted}
        if before.get(name) != wanted.get(name)
    ]
    if changed:
        raise ValueError(f"{folder.name} holds parts of another run: {'; '.join(changed)}")


def _short(value: Any) -> str:
    return textwrap.shorten(str(value), 60, placeholder=" ...")


@contextmanager
def _drafted(folder: Path, name: str) -> Iterator[Any]:
    """Write a file beside its place, and put it there whole."""
    draft: str | None = None
    try:
        handle, draft = tempfile.mkstemp(prefix=_DRAFT, dir=folder)
        with os.fdopen(handle, "wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.replace(draft, folder / name)
    except OSError as error:
        raise OSError(
            error.errno,
            f"{error.strerror or error} (while writing {folder / name}; the parts before it stay)",
        ) from error
    finally:
        if draft is not None:
            with suppress(OSError):
                os.unlink(draft)
