"""Tests of this folder share the writers in ``files_of_frames.py``."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
