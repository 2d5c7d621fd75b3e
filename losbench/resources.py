"""Where the data and the notebooks lie: in the checkout, or inside an installed wheel; and where
output goes.
"""

from __future__ import annotations

import os
from pathlib import Path

__all__ = [
    "build_folder",
    "data_file",
    "documents_folder",
    "notebook_folder",
    "write_whole",
]

_PACKAGE = Path(__file__).resolve().parent
_CHECKOUT = _PACKAGE.parent
_IN_CHECKOUT = (_CHECKOUT / "pyproject.toml").is_file() and (_CHECKOUT / "data").is_dir()
_HOME = _CHECKOUT if _IN_CHECKOUT else _PACKAGE / "shipped"


def data_file(name: str) -> Path:
    """Return the path of a file of ``data/``, e.g. ``claims.csv``; ``FileNotFoundError`` names what
    is there.
    """
    path = _HOME / "data" / name
    if not path.is_file():
        present = ", ".join(sorted(p.name for p in path.parent.glob("*")))
        raise FileNotFoundError(f"no data file {name!r}; there is {present or 'none'}")
    return path


def notebook_folder() -> Path:
    """Return the folder that holds the numbered notebooks."""
    return _HOME / "notebooks"


def documents_folder() -> Path:
    """Return the folder that holds the pages of the site which no notebook makes."""
    return _HOME / "docs"


def build_folder() -> Path:
    """Return the folder that figures, tables and verdicts are written to.

    ``LOSBENCH_BUILD`` names it; else it is ``build`` in the checkout, or in the working directory
    of an installation.
    """
    named = os.environ.get("LOSBENCH_BUILD")
    return Path(named) if named else (_CHECKOUT if _IN_CHECKOUT else Path.cwd()) / "build"


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file under a temporary name, then rename it: whoever looks finds the old file or the
    new one, whole.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{path.name}.{os.getpid()}")
    draft.write_bytes(content.encode() if isinstance(content, str) else content)
    draft.replace(path)
