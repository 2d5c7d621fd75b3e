"""Folders of results that are whole whatever happens: the old one or the new one, never a part.

A run claims its folder before it reads anything, writes beside it, and swaps when all is written,
``report.json`` last, which lists every file with its sha256. What a killed run left is put right by
the next.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from losbench.made import plain

__all__ = ["REPORT", "Claim", "claim", "into", "locked"]

REPORT = "report.json"


@dataclass(frozen=True)
class Claim:
    """A folder that is written to, by `claim`.

    Attributes
    ----------
    folder : Path
        Where the results will stand.
    draft : Path
        Where they are written until then.
    """

    folder: Path
    draft: Path
    _sha256: dict[str, str] = field(default_factory=dict)

    @property
    def written(self) -> list[str]:
        """Names of the files that have been written, in order."""
        return list(self._sha256)

    def write(self, name: str, content: str | bytes) -> None:
        """Write a file of the results, ``name`` with slashes for folders within.

        Raises
        ------
        OSError
            With the file's name, and that the folder is as it was.
        """
        data = content if isinstance(content, bytes) else content.encode()
        with self._told(name):
            path = self.draft / name
            path.parent.mkdir(parents=True, exist_ok=True)
            _write(path, data)
        self._sha256[name] = hashlib.sha256(data).hexdigest()

    def gather(self) -> None:
        """Take what was written to the draft by others into the list of files."""
        for path in sorted(self.draft.rglob("*")):
            if path.is_file():
                with path.open("rb") as file:
                    digest = hashlib.file_digest(file, "sha256").hexdigest()
                self._sha256[path.relative_to(self.draft).as_posix()] = digest

    def publish(self, report: Mapping[str, Any]) -> None:
        """Write ``report.json``, the list of files added, and put all in the folder's place.

        Files of the folder that no list of losbench names stay in it.

        Raises
        ------
        FileExistsError
            If one of them has the name of a file that was written.
        OSError
            If it cannot be written; it says whether the folder is as it was.
        """
        _check_free(self.folder, self.folder, self._sha256)
        listed = {"files": dict(sorted(self._sha256.items()))}
        with self._told(REPORT):
            text = json.dumps(plain({**report, **listed}), indent=1, allow_nan=False) + "\n"
            _write(self.draft / REPORT, text.encode())
            _sync(self.draft)
        old = _beside(self.folder, "old")
        with self._told(""):
            if self.folder.exists():
                self.folder.rename(old)
            try:
                self.draft.rename(self.folder)
            except OSError:
                if old.exists():
                    old.rename(self.folder)
                raise
        _sync(self.folder.parent)
        try:
            _settle(self.folder)
        except OSError as error:
            raise OSError(
                error.errno,
                f"{error.strerror or error} (while removing the old results, {old}; {self.folder} "
                "holds the new ones)",
            ) from error

    @contextmanager
    def _told(self, name: str) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise OSError(
                error.errno,
                f"{error.strerror or error} (while writing {self.folder / name}; {self.folder} is "
                "as it was)",
            ) from error


@contextmanager
def claim(
    out: str | Path,
    *,
    inputs: Iterable[str | Path] = (),
    writes: Iterable[str] = (),
    force: bool = False,
) -> Iterator[Claim]:
    r"""Claim a folder for results before the work begins; `Claim.publish` alone changes it.

    Parameters
    ----------
    out : path
        The folder; it need not exist.
    inputs : paths
        What the run reads, which must not lie in it, nor it among them.
    writes : str
        Names of files that may be written; forced or not, no file of the user's own gives way.
    force : bool
        Replace the results that an earlier run left in the folder.

    Raises
    ------
    FileExistsError
        If the folder holds anything and ``force`` is not set, or a file of the user's own has the
        name of one that is to be written.
    OSError
        If nothing can be written there, or another run writes to the folder.
    ValueError
        If an input would be overwritten.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as parent, claim(parent + "/out") as results:
    ...     results.write("table.csv", "x\n1\n")
    ...     results.publish({"losbench": "0.1.0"})
    ...     sorted(path.name for path in results.folder.iterdir())
    ['report.json', 'table.csv']
    """
    folder = Path(os.path.realpath(out))
    if folder.exists() and not folder.is_dir():
        raise FileExistsError(f"{out} must be a folder, but is a file")
    if folder.is_mount():
        raise FileExistsError(f"{out} is where a disk is mounted: choose a folder within it")
    for given in inputs:
        for path in {os.path.abspath(given), os.path.realpath(given)}:
            _check_apart(folder, Path(path))
    with locked(folder):
        _settle(folder)
        if folder.is_dir() and any(folder.iterdir()):
            if not force:
                raise FileExistsError(
                    f"{out} is not empty: choose another folder, or overwrite with --force"
                )
            _check_free(out, folder, writes)
        draft = _beside(folder, "new")
        try:
            draft.mkdir()
            _write(draft / "test", b"x")  # what cannot be written is better known now
            (draft / "test").unlink()
        except OSError as error:
            shutil.rmtree(draft, ignore_errors=True)
            raise OSError(error.errno, f"cannot write to {out}: {error.strerror}") from error
        try:
            yield Claim(folder, draft)
        finally:
            shutil.rmtree(draft, ignore_errors=True)


@contextmanager
def into(target: str | Path | Claim, writes: Iterable[str]) -> Iterator[Claim]:
    """A folder that was claimed before, or one that is claimed now, in place of earlier results."""
    if isinstance(target, Claim):
        yield target
    else:
        with claim(target, writes=writes, force=True) as results:
            yield results


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep other runs from a folder; the lock goes with the process that holds it."""
    path = _beside(folder, "lock")
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        handle = _open_lock(path)
    except OSError as error:
        raise OSError(error.errno, f"cannot write to {folder}: {error.strerror}") from error
    try:
        yield
    finally:
        with suppress(OSError):
            path.unlink()
        os.close(handle)


def _open_lock(path: Path) -> int:
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            if sys.platform == "win32":
                import msvcrt

                msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
            else:
                import fcntl

                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(handle)
            name = path.name.removeprefix(".").removesuffix(".lock")
            raise BlockingIOError(11, f"another run is writing to {name}") from None
        # The run before may have removed the very file that this one opened.
        with suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(handle), os.stat(path)):
                return handle
        os.close(handle)


def _settle(folder: Path) -> None:
    """Put right what an earlier run left: the old results back if no new ones stand in their place,
    else what was the user's own among them moved over, and the rest removed.
    """
    old = _beside(folder, "old")
    if old.is_dir():
        if not folder.exists():
            old.rename(folder)
        else:
            for name in sorted(_own_files(old)):
                target = folder / name
                if not target.exists():
                    target.parent.mkdir(parents=True, exist_ok=True)
                    (old / name).rename(target)
            shutil.rmtree(old)
    shutil.rmtree(_beside(folder, "new"), ignore_errors=True)


def _own_files(folder: Path) -> set[str]:
    """Files of a folder that its list does not name: they are the user's own."""
    listed: set[str] = set()
    with suppress(OSError, ValueError, AttributeError, TypeError):
        listed = {REPORT, *json.loads((folder / REPORT).read_text(encoding="utf-8"))["files"]}
    found = (path for path in folder.rglob("*") if not path.is_dir() or path.is_symlink())
    return {path.relative_to(folder).as_posix() for path in found} - listed


def _check_free(out: str | Path, folder: Path, writes: Iterable[str]) -> None:
    taken = sorted(set(writes) & _own_files(folder))
    if taken:
        raise FileExistsError(
            f"{out} holds {taken[0]}, which no earlier run of losbench lists as its own: choose "
            "another folder"
        )


def _check_apart(folder: Path, given: Path) -> None:
    if given == folder or folder in given.parents:
        raise ValueError(f"{given.name} lies in the folder to write to, {folder}: choose another")
    if given in folder.parents:
        raise ValueError(f"{folder} lies among the files to read, in {given}: choose another")


def _beside(folder: Path, what: str) -> Path:
    return folder.parent / f".{folder.name}.{what}"


def _write(path: Path, data: bytes) -> None:
    with path.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def _sync(folder: Path) -> None:
    """Make renames within a folder last, where the system can."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
