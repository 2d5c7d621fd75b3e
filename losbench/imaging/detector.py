"""A CMOS or CCD sensor: from expected electrons to the numbers that a camera writes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from losbench.arrays import Floats
from losbench.checks import (
    finite,
    generator,
    integer,
    named_twice,
    non_negative,
    number,
    positive,
    shaped,
)
from losbench.parameters import from_table, read_toml, to_table

__all__ = ["Detector"]


_MOST_E = 1e18  # what can be counted in 64 bits


@dataclass(frozen=True, kw_only=True)
class Detector:
    """Noise, response and digitisation of a sensor.

    Parameters
    ----------
    gain_e_per_dn : float
        Electrons per digital number (DN).
    read_noise_e : float
        Standard deviation of the read noise, electrons.
    offset_dn : float
        Reading of a dark pixel.
    full_well_e : float
        Electrons at which a pixel saturates.
    bits : int
        Bits of the converter, 8 to 16; readings are clipped at 2**bits - 1.
    prnu : float
        Pixel response non-uniformity: relative standard deviation of the pixels' sensitivity, a
        fixed pattern.
    prnu_seed : int
        Which pattern. Pixel (x, y) of the sensor has the same response whatever window is exposed.
    hot_pixels : tuple of (x, y, electrons)
        Sensor pixels with that many extra electrons per exposure on average.

    Raises
    ------
    ValueError
        If a parameter lies outside its range.

    Examples
    --------
    >>> detector = Detector(gain_e_per_dn=2.0, read_noise_e=3.0, offset_dn=100.0, bits=12)
    >>> frame = detector.expose(np.full((4, 5), 1000.0), np.random.default_rng(1))
    >>> frame.dtype, frame.shape, bool(abs(frame.mean() - 600) < 15)
    (dtype('uint16'), (4, 5), True)
    """

    gain_e_per_dn: float = 1.0
    read_noise_e: float = 0.0
    offset_dn: float = 0.0
    full_well_e: float = np.inf
    bits: int = 16
    prnu: float = 0.0
    prnu_seed: int = 0
    hot_pixels: tuple[tuple[int, int, float], ...] = ()

    def __post_init__(self) -> None:
        positive("gain_e_per_dn", number("gain_e_per_dn", self.gain_e_per_dn))
        number("read_noise_e", self.read_noise_e, low=0)
        number("offset_dn", self.offset_dn, low=0)
        if self.full_well_e != np.inf:
            positive("full_well_e", number("full_well_e", self.full_well_e))
        integer("bits", self.bits, low=8, high=16)
        number("prnu", self.prnu, low=0, high=0.5)
        integer("prnu_seed", self.prnu_seed, low=0, high=2**63)
        if not isinstance(self.hot_pixels, tuple | list):
            raise ValueError(
                f"hot_pixels must be a tuple of (x, y, electrons), got {self.hot_pixels!r}"
            )
        for pixel in self.hot_pixels:
            if not _is_hot_pixel(pixel):
                raise ValueError(
                    "hot_pixels must be (x, y, electrons) with electrons of at least 0, got "
                    f"{pixel!r}"
                )

    @classmethod
    def from_toml(cls, path: str | Path) -> Self | None:
        """Read the table ``[detector]`` of a camera's TOML file; None if it has none.

        Raises
        ------
        ValueError
            Naming the file, if it is not TOML, or the table has an unknown key or a value that does
            not fit.
        """
        table = read_toml(path).get("detector")
        return None if table is None else from_table(cls, table, where=f"{path} [detector]")

    def to_toml(self) -> str:
        """Return the detector as a TOML table that :meth:`from_toml` reads."""
        return "[detector]\n" + to_table(self) + "\n"

    @property
    def full_scale_dn(self) -> float:
        """Reading of a saturated pixel: the full well, or the end of the converter if that comes
        first.
        """
        return min(2.0**self.bits - 1.0, self.offset_dn + self.full_well_e / self.gain_e_per_dn)

    @property
    def per_dn(self) -> float:
        """Variance per signal, DN: the inverse of the gain."""
        return 1.0 / self.gain_e_per_dn

    def variance_dn(self, reading_dn: ArrayLike) -> Floats:
        """Variance of a reading, DN squared: shot noise, read noise and rounding; linear in the
        reading, any shape.

        >>> float(
        ...     Detector(gain_e_per_dn=2.0, read_noise_e=4.0, offset_dn=10.0)
        ...     .variance_dn(110.0)
        ...     .round(3)
        ... )
        54.083
        """
        shot = (np.asarray(reading_dn, dtype=np.float64) - self.offset_dn) / self.gain_e_per_dn
        return shot + (self.read_noise_e / self.gain_e_per_dn) ** 2 + 1.0 / 12.0

    def expose(
        self,
        electrons: ArrayLike,
        seed: np.random.Generator | int | None = None,
        *,
        origin: ArrayLike = (0, 0),
        rng: np.random.Generator | int | None = None,
    ) -> NDArray[np.uint16]:
        """Read out frames whose pixels expect the given electrons.

        Parameters
        ----------
        electrons : (..., rows, columns) array
            Expected electrons of each pixel, background included.
        seed : int or numpy Generator
            Source of shot noise and read noise; must be given.
        origin : (2,) or (..., 2) whole numbers
            Sensor coordinates (x, y) of the window's first pixel, which place the fixed pattern and
            the hot pixels.
        rng
            Second word for ``seed``.

        Returns
        -------
        (..., rows, columns) array of uint16

        Raises
        ------
        ValueError
            If electrons are negative, not finite or not an image.
        """
        expected = np.asarray(electrons, dtype=np.float64)
        shaped("electrons", expected, ("...", "rows", "columns"))
        if expected.size and not (expected.min() >= 0 and expected.max() < np.inf):
            non_negative("electrons", expected)
        if expected.size and expected.max() > _MOST_E:
            raise ValueError(
                f"electrons must be at most {_MOST_E:g} a pixel, got {expected.max():g}"
            )
        corner = finite("origin", origin)
        shaped("origin", corner, ("...", 2))
        random = generator(*named_twice("seed", seed, None, rng=rng))

        counts = random.poisson(
            self._collected(expected, np.broadcast_to(corner, (*expected.shape[:-2], 2)))
        )
        # Single precision resolves 1/100 of a DN over 16 bits and halves the cost of a full frame.
        reading = random.standard_normal(expected.shape, dtype=np.float32)
        reading *= self.read_noise_e
        reading += np.minimum(counts, self.full_well_e, dtype=np.float32)
        reading /= self.gain_e_per_dn
        reading += self.offset_dn
        np.rint(reading, out=reading)
        np.clip(reading, 0, np.floor(self.full_scale_dn), out=reading)
        return reading.astype(np.uint16)

    def _collected(self, expected: Floats, corner: Floats) -> Floats:
        """Expected electrons after pixel response and hot pixels."""
        if self.prnu:
            expected = expected * np.maximum(
                0.0, 1.0 + self.prnu * self._response_pattern(expected.shape, corner)
            )
        if self.hot_pixels:
            frames = expected.reshape(-1, *expected.shape[-2:]).copy()
            corners = corner.reshape(-1, 2)
            for x, y, extra in self.hot_pixels:
                column, row = (np.rint((x, y) - corners).astype(int)).T
                inside = (
                    (column >= 0)
                    & (column < frames.shape[2])
                    & (row >= 0)
                    & (row < frames.shape[1])
                )
                frames[inside.nonzero()[0], row[inside], column[inside]] += extra
            expected = frames.reshape(expected.shape)
        return expected

    def _response_pattern(self, shape: tuple[int, ...], corner: Floats) -> Floats:
        """Standard normal number of each sensor pixel, a hash of seed and place: the same in any
        window.
        """
        place = np.rint(corner).astype(np.int64)
        x = (place[..., 0, None, None] + np.arange(shape[-1])).astype(np.uint64)
        y = (place[..., 1, None, None] + np.arange(shape[-2])[:, None]).astype(np.uint64)
        mixed = _splitmix64(
            _splitmix64(_splitmix64(np.array([self.prnu_seed], dtype=np.uint64)) ^ y) ^ x
        )
        return ndtri(((mixed >> np.uint64(11)).astype(np.float64) + 0.5) * 2.0**-53)


def _is_hot_pixel(pixel: object) -> bool:
    try:
        x, y, electrons = map(float, pixel)  # type: ignore[call-overload]
    except (TypeError, ValueError):
        return False
    return bool(np.isfinite([x, y]).all() and electrons >= 0)


def _splitmix64(state: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Mix 64-bit integers so that neighbours become independent (Steele, Lea and Flood 2014)."""
    mixed = state + np.uint64(0x9E3779B97F4A7C15)
    mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return mixed ^ (mixed >> np.uint64(31))
