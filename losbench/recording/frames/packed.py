"""Numbers of 10, 12 or 14 bits packed without gaps."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["unpacked", "unpacked_gige"]


def unpacked(
    lines: NDArray[np.uint8], bits: int, columns: int, *, high_first: bool = False
) -> NDArray[np.uint16]:
    """Unpack lines of bytes (..., n) to (..., columns) numbers.

    The low bits come first, as in GenICam's Mono10p and Mono12p, or the high ones, as in TIFF.

    >>> line = np.array([[0x12, 0x34, 0x56]], np.uint8)
    >>> unpacked(line, 12, 2).tolist(), unpacked(line, 12, 2, high_first=True).tolist()
    ([[1042, 1379]], [[291, 1110]])
    """
    group = math.lcm(bits, 8) // 8
    per_group = group * 8 // bits
    n_groups = -(-columns // per_group)
    short = n_groups * group - lines.shape[-1]
    if short > 0:  # the last group of a line may be cut where its numbers end
        lines = np.concatenate([lines, np.zeros((*lines.shape[:-1], short), np.uint8)], axis=-1)
    parts = lines[..., : n_groups * group].reshape(*lines.shape[:-1], n_groups, group)
    wide: Any = np.uint32 if group < 4 else np.uint64
    word = np.zeros(parts.shape[:-1], wide)
    for k in range(group):
        word |= parts[..., k].astype(wide) << wide(8 * (group - 1 - k if high_first else k))
    numbers = np.empty((*word.shape, per_group), np.uint16)
    for k in range(per_group):
        shift = bits * (per_group - 1 - k if high_first else k)
        numbers[..., k] = (word >> wide(shift)) & wide(2**bits - 1)
    return numbers.reshape(*lines.shape[:-1], n_groups * per_group)[..., :columns]


def unpacked_gige(lines: NDArray[np.uint8], bits: int, columns: int) -> NDArray[np.uint16]:
    """Unpack GigE Vision's Mono10Packed and Mono12Packed: two numbers in three bytes, whose middle
    one holds the low bits of both.

    >>> unpacked_gige(np.array([[0x12, 0x34, 0x56]], np.uint8), 12, 2).tolist()
    [[292, 1379]]
    """
    n_groups = -(-columns // 2)
    parts = lines[..., : n_groups * 3].reshape(*lines.shape[:-1], n_groups, 3).astype(np.uint16)
    low, mask = bits - 8, 2 ** (bits - 8) - 1
    numbers = np.empty((*parts.shape[:-1], 2), np.uint16)
    numbers[..., 0] = parts[..., 0] << low | parts[..., 1] & mask
    numbers[..., 1] = parts[..., 2] << low | (parts[..., 1] >> 4) & mask
    return numbers.reshape(*lines.shape[:-1], n_groups * 2)[..., :columns]
