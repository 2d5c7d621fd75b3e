"""What several tests share."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

_BESIDE = Path(__file__).resolve().parents[1].parent / "shared" / "real"


@pytest.fixture(scope="session")
def real_data() -> Callable[[str], Path]:
    """Return a folder of real recordings, which are not part of the project, or skip the test where it is missing."""

    def folder(name: str) -> Path:
        path = Path(os.environ.get("LOSBENCH_REAL_DATA", _BESIDE)) / name
        if not path.is_dir():
            pytest.skip(
                f"no folder {name} in LOSBENCH_REAL_DATA or beside the checkout; data/README.md says what it holds"
            )
        return path

    return folder
