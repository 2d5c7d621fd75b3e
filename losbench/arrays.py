"""The arrays that everything hands on: what ``Floats`` means is said here, once."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

__all__ = ["Bools", "Floats", "Indices", "Ints", "Pixels"]

Floats: TypeAlias = NDArray[np.float64]
Bools: TypeAlias = NDArray[np.bool_]
Ints: TypeAlias = NDArray[np.int64]
Indices: TypeAlias = NDArray[np.intp]
Pixels: TypeAlias = NDArray[np.floating[Any]]  # frames and stamps, float32 or float64
