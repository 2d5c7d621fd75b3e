"""What the set-up says where it cannot go on: one clear line, whatever is missing."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parent.parent / ".ci" / "set-up"
pytestmark = pytest.mark.skipif(
    shutil.which("bash") is None or not SCRIPT.is_file(),
    reason="needs bash and a checkout with .ci",
)


def set_up(folder, lock="numpy==2.4.0\n", python=sys.executable, **extra):
    (folder / "requirements.lock").write_text(lock)
    environment = {**os.environ, "PYTHON": str(python), "UV": "", **extra}
    return subprocess.run(
        [SCRIPT, ".venv", "requirements.lock"],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


def pretending(folder, preparation):
    """Write an interpreter that runs ``preparation`` before the code that it is given."""
    fake = folder / "python"
    fake.write_text(
        f'#!/bin/sh\nexec "{sys.executable}" -c "import sys; {preparation}; exec(sys.argv[1])" '
        '"$2"\n'
    )
    fake.chmod(0o755)
    return fake


def test_too_old_a_python_is_named(tmp_path):
    done = set_up(tmp_path, python=pretending(tmp_path, "sys.version_info = (3, 9, 2)"))
    assert done.returncode == 1
    assert "Python 3.11 or newer is needed, but" in done.stderr
    assert "is 3.9; name another: make PYTHON=python3.12" in done.stderr


def test_no_python_at_all_is_said(tmp_path):
    done = set_up(tmp_path, python=tmp_path / "none")
    assert done.returncode == 1
    assert "no Python found; install Python 3.11 to 3.13" in done.stderr


def test_a_missing_venv_module_is_said(tmp_path):
    done = set_up(tmp_path, python=pretending(tmp_path, "sys.modules['ensurepip'] = None"))
    assert done.returncode == 1
    assert "has no venv module; on Debian and Ubuntu: apt-get install python3-venv" in done.stderr
    assert not (tmp_path / ".venv").exists()


@pytest.mark.parametrize(
    ("lock", "message"),
    [
        ("", "requirements.lock is missing or empty"),
        ("numpy==2.4.0\n", "requirements.lock could not be installed"),
    ],
)
def test_a_broken_lock_is_said(tmp_path, lock, message):
    done = set_up(tmp_path, lock, PIP_NO_INDEX="1", PIP_NO_INPUT="1")
    assert done.returncode == 1
    assert done.stderr.strip().splitlines()[-1].startswith(f"losbench set-up: {message}")
