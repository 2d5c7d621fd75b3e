"""How results were made: the command, its settings, what was read, and with which versions."""

from __future__ import annotations

import glob
import hashlib
import platform
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, is_dataclass
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Self

import numpy as np

from losbench.__about__ import __version__

__all__ = ["SCHEMA_VERSION", "Made", "Source", "head_of", "plain", "versions"]

SCHEMA_VERSION = 1  # of report.json, whose schema is report.schema.json

_PACKAGES = (
    "losbench",
    "numpy",
    "scipy",
    "matplotlib",
    "opencv-python-headless",
    "pandas",
    "statsmodels",
)
_LARGEST = 100_000_000  # bytes that are read to the last one
_END = 1_000_000


def head_of(kind: str, made: Made) -> dict[str, Any]:
    """Return what every report.json begins with: its kind and version, and how it was made."""
    return {
        "losbench": __version__,
        "kind": kind,
        "version": SCHEMA_VERSION,
        "made": made.to_dict(),
    }


@cache
def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that results depend on."""
    found = {"python": platform.python_version()}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


@dataclass(frozen=True)
class Source:
    """A file, or a folder's files, as they were when they were read.

    Attributes
    ----------
    name : str
    n_files, size_bytes : int
    modified_utc : str
        Of the youngest file.
    sha256 : str or None
        Of the file; of several, of the text that ``sha256sum *`` prints of them. None beyond
        100 MB.
    sha256_of_ends : str or None
        Then of the first MB of the first file and the last MB of the last one.
    """

    name: str
    n_files: int
    size_bytes: int
    modified_utc: str
    sha256: str | None
    sha256_of_ends: str | None

    @classmethod
    def of(cls, path: str | Path) -> Self | None:
        """Look at a file, a folder or a pattern; None where there is nothing.

        Examples
        --------
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     _ = Path(folder, "a").write_bytes(b"abc")
        ...     source = Source.of(Path(folder, "a"))
        >>> source.size_bytes, source.sha256[:8]
        (3, 'ba7816bf')
        """
        files = _files(path)
        if not files:
            return None
        stats = [file.stat() for file in files]
        size = sum(stat.st_size for stat in stats)
        small = size <= _LARGEST
        return cls(
            name=Path(path).name or str(path),
            n_files=len(files),
            size_bytes=size,
            modified_utc=_utc(max(stat.st_mtime for stat in stats)),
            sha256=_whole(files) if small else None,
            sha256_of_ends=None if small else _ends(files),
        )


@dataclass(frozen=True)
class Made:
    """How results were made.

    Attributes
    ----------
    command : str or None
        As it could be given again; None where a program called the library.
    settings : mapping
        Every setting by name, those that were left as they are included.
    inputs : tuple of Source
        What was read.
    when_utc : str
    versions : mapping of str to str
        Of Python and the packages that compute.
    """

    command: str | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    inputs: tuple[Source, ...] = ()
    when_utc: str = field(default_factory=lambda: _utc(datetime.now(UTC).timestamp()))
    versions: Mapping[str, str] = field(default_factory=versions)

    @classmethod
    def by(
        cls,
        command: str | None,
        settings: Mapping[str, Any],
        inputs: Iterable[str | Path],
    ) -> Self:
        """Make one, with a look at the inputs."""
        found = [Source.of(path) for path in inputs]
        return cls(command, plain(settings), tuple(each for each in found if each is not None))

    def to_dict(self) -> dict[str, Any]:
        """Return it as JSON has it."""
        told: dict[str, Any] = plain(self)
        return told


def plain(value: Any) -> Any:
    """Turn dataclasses, arrays, paths and mappings into what JSON holds, numbers that are none into
    None; anything else into its repr.

    >>> plain({"a": np.array([1.0, np.nan]), 2: (Path("b"), np.int64(3))})
    {'a': [1.0, None], '2': ['b', 3]}
    """
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    if isinstance(value, Path):
        return str(value)
    return value if value is None or isinstance(value, str | int) else repr(value)


def _files(path: str | Path) -> list[Path]:
    given = Path(path)
    if given.is_file():
        return [given]
    found = given.iterdir() if given.is_dir() else map(Path, glob.glob(str(path)))
    return sorted(each for each in found if each.is_file())


def _whole(files: list[Path]) -> str:
    sums = []
    for file in files:
        with file.open("rb") as stream:
            sums.append(hashlib.file_digest(stream, "sha256").hexdigest())
    if len(files) == 1:
        return sums[0]
    listed = "".join(f"{one}  {file.name}\n" for one, file in zip(sums, files, strict=True))
    return hashlib.sha256(listed.encode()).hexdigest()


def _ends(files: list[Path]) -> str:
    digest = hashlib.sha256()
    with files[0].open("rb") as stream:
        digest.update(stream.read(_END))
    with files[-1].open("rb") as stream:
        stream.seek(max(0, files[-1].stat().st_size - _END))
        digest.update(stream.read())
    return digest.hexdigest()


def _utc(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
