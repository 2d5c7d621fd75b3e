"""Real stars: a table of the bright ones, any Hipparcos or Tycho-2 file that a user brings, and
fields of view.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Floats, Ints
from losbench.checks import generator, integer, named_twice, number, rotation
from losbench.optics.camera import Camera
from losbench.resources import data_file

__all__ = ["Catalogue", "Field", "load_catalogue", "random_attitudes"]


_RAD_PER_MAS = np.pi / (180 * 3600e3)
_HIPPARCOS_EPOCH = 1991.25
_LARGEST_IDENT = 9_999_999_999  # TYC1 * 1e6 + TYC2 * 10 + TYC3
_BRIGHTEST, _FAINTEST = -2.0, 25.0
_FASTEST_MAS = 30_000.0  # a year; Barnard's star, the fastest, moves by 10 400


class _Star(NamedTuple):
    ident: int
    ra: float  # rad, as dec
    dec: float
    pm_ra: float  # mas/yr, as pm_dec
    pm_dec: float
    epoch: float
    magnitude: float


@dataclass(frozen=True)
class Field:
    """Stars that a camera sees, brightest first.

    Parameters
    ----------
    xy : (n, 2) array, pixels
    magnitude : (n,) array
    ident : (n,) array of int
        Their numbers in the catalogue.
    """

    xy: Floats
    magnitude: Floats
    ident: Ints


@dataclass(frozen=True)
class Catalogue:
    """Directions of stars.

    Parameters
    ----------
    direction : (n, 3) array
        Unit vectors in ICRS.
    magnitude : (n,) array
        Hp for Hipparcos, the old and the new, VT for Tycho-2.
    ident : (n,) array of int
        HIP number; for Tycho-2 its three parts as TYC1 * 1e6 + TYC2 * 10 + TYC3.
    epoch : float, Julian years
        To which proper motion was applied.
    """

    direction: Floats
    magnitude: Floats
    ident: Ints
    epoch: float = 2000.0

    def field(
        self,
        attitude: ArrayLike,
        camera: Camera,
        *,
        faintest: float = np.inf,
        margin_px: float = 0.0,
        most: int | None = None,
    ) -> Field:
        """Find the stars on a camera's detector.

        Parameters
        ----------
        attitude : (3, 3) array
            Rotation that carries ICRS directions into the camera frame.
        camera : Camera
        faintest : float, magnitude
        margin_px : float, pixels
            Leave out stars nearer to the border; negative to take in those just outside.
        most : int, optional
            Keep only that many, the brightest.

        Returns
        -------
        Field
            Empty if there are none.

        Raises
        ------
        ValueError
            If the attitude is no rotation matrix, or a limit no number.

        Examples
        --------
        >>> camera = Camera(focal_mm=36.6097, pixel_um=10.0, shape=(512, 512))
        >>> polaris = (
        ...     load_catalogue().field(np.eye(3), camera).ident[0]
        ... )  # along +z: the celestial north pole
        >>> int(polaris)
        11767
        """
        turn = rotation("attitude", attitude)
        bright = self.magnitude <= (np.inf if faintest == np.inf else number("faintest", faintest))
        rows, columns = camera.shape
        corners = camera.points_mm(
            [[x, y] for x in (-0.5, columns - 0.5) for y in (-0.5, rows - 0.5)]
        )
        reach = max(np.linalg.norm(corners[:, :2], axis=1).max() / camera.focal_mm, 1e-9)
        ahead = self.direction @ turn[2]
        near = np.flatnonzero(
            bright & (ahead > np.cos(np.arctan(reach) + _slack(margin_px, camera)))
        )
        xy = camera.pixels(self.direction[near] @ turn.T) if near.size else np.empty((0, 2))
        low, high = -0.5 + margin_px, np.array([columns, rows]) - 0.5 - margin_px
        seen = ((xy >= low) & (xy <= high)).all(axis=1)
        chosen, xy = near[seen], xy[seen]
        order = np.argsort(self.magnitude[chosen], kind="stable")[
            : None if most is None else integer("most", most, low=0)
        ]
        return Field(xy[order], self.magnitude[chosen[order]], self.ident[chosen[order]])


def load_catalogue(
    path: str | Path | None = None, *, faintest: float = 99.0, epoch: float = 2000.0
) -> Catalogue:
    """Load stars: those that come with losbench (Hipparcos, to Hp 6.5), or a catalogue of your own.

    Parameters
    ----------
    path : path, optional
        ``hip2.dat`` (van Leeuwen 2007, CDS I/311), ``hip_main.dat`` (ESA 1997, CDS I/239) or
        ``tyc2.dat`` (CDS I/259), as CDS has them, plain text.
    faintest : float, magnitude
        Leave out fainter stars.
    epoch : float, Julian years
        Apply proper motion up to then; the stars that come with losbench are at 2000.0.

    Returns
    -------
    Catalogue

    Raises
    ------
    ValueError
        If the file is none of the three or a line of it cannot be read, or another epoch is asked
        of the table that comes with losbench.

    Examples
    --------
    >>> stars = load_catalogue()
    >>> len(stars.magnitude), int(stars.ident[stars.magnitude.argmin()])  # Sirius
    (7982, 32349)
    """
    limit, year = number("faintest", faintest), number("epoch", epoch)
    if path is None:
        if year != 2000.0:
            raise ValueError(
                f"epoch must be 2000 for the stars that come with losbench, got {year:g}"
            )
        return _shipped(limit)
    with open(path, encoding="ascii", errors="replace") as file:
        kind = _kind(file.readline())
    if kind not in _ROWS:
        raise ValueError(
            f"{path} is none of hip2.dat (CDS I/311), hip_main.dat (CDS I/239) and tyc2.dat (CDS "
            "I/259)"
        )
    return _read(Path(path), _ROWS[kind], limit, year)


def random_attitudes(
    n: int,
    seed: np.random.Generator | int | None = None,
    *,
    rng: np.random.Generator | int | None = None,
) -> Floats:
    """Draw rotations (n, 3, 3) from the sky to the camera, uniform over all orientations.

    ``seed`` is an int or a numpy Generator and must be given; ``rng`` is a second word for it.

    >>> bool(np.allclose(np.linalg.det(random_attitudes(5, 1)), 1.0))
    True
    """
    from scipy.spatial.transform import Rotation  # half the time that `import losbench` may take

    count = integer("n", n, low=0)
    random = generator(*named_twice("seed", seed, None, rng=rng))
    quaternions = random.standard_normal((count, 4))
    return Rotation.from_quat(quaternions).as_matrix() if count else np.empty((0, 3, 3))


def _slack(margin_px: float, camera: Camera) -> float:
    return (
        max(0.0, -number("margin_px", margin_px)) * np.sqrt(2.0) * camera.pixel_mm / camera.focal_mm
    )


def _shipped(faintest: float) -> Catalogue:
    with np.load(data_file("stars-hp65.npz")) as table:
        magnitude = table["magnitude"] / 1000.0
        kept = magnitude <= faintest
        direction = table["direction"][kept] / 2.0**31
        return Catalogue(direction, magnitude[kept], table["hip"][kept].astype(np.int64))


def _kind(line: str) -> str:
    parts = line.split("|")
    if len(parts) > 20:
        return "hip1" if parts[0] == "H" else "tyc2" if len(parts[0].split()) == 3 else "unknown"
    fields = line.split()
    return "hip2" if len(fields) >= 20 and fields[0].isdigit() and "|" not in line else "unknown"


def _read(
    path: Path, row: Callable[[str], _Star | None], faintest: float, epoch: float
) -> Catalogue:
    stars = []
    with open(path, encoding="ascii", errors="replace") as file:
        for count, line in enumerate(file, start=1):
            if not line.strip():
                continue
            try:
                star = row(line)
            except IndexError:
                raise ValueError(f"{path}, line {count} has too few columns") from None
            except ValueError as error:
                raise ValueError(f"{path}, line {count}: {str(error)[:200]}") from None
            if star is not None and star.magnitude <= faintest:
                stars.append(star)
    idents = np.array([star.ident for star in stars], dtype=np.int64)
    ra, dec, pm_ra, pm_dec, year, magnitude = (
        np.array([star[1:] for star in stars], dtype=np.float64).reshape(-1, 6).T
    )
    return Catalogue(_moved(ra, dec, pm_ra, pm_dec, epoch - year), magnitude, idents, epoch)


def _hipparcos_row(line: str) -> _Star:
    """Columns of I/311: HIP, Sn, So, Nc, RA and Dec (rad), parallax, pmRA cos(Dec), pmDec (mas/yr),
    ..., Hp.
    """
    parts = line.split()
    return _star(
        int(parts[0]), [float(parts[k]) for k in (4, 5, 7, 8)], _HIPPARCOS_EPOCH, parts[19]
    )


def _first_hipparcos_row(line: str) -> _Star | None:
    """Columns of I/239 by '|': H, HIP, ..., RA and Dec (deg) as the 9th and 10th, pm (mas/yr) as
    the 13th, Hp 45th.
    """
    parts = line.split("|")
    if not (parts[8].strip() and parts[44].strip()):
        return None  # 263 stars have no solution
    ra, dec, *motion = (float(parts[k]) for k in (8, 9, 12, 13))
    return _star(
        int(parts[1]), [math.radians(ra), math.radians(dec), *motion], _HIPPARCOS_EPOCH, parts[44]
    )


def _tycho_row(line: str) -> _Star | None:
    """Columns of I/259 by '|': TYC, flag, RA and Dec (deg, J2000), pm (mas/yr), ..., VT as the
    20th; X has no mean.
    """
    parts = line.split("|")
    if parts[1] == "X" or not parts[19].strip():
        return None
    one, two, three = map(int, parts[0].split())
    ra, dec, *motion = (float(parts[k]) for k in (2, 3, 4, 5))
    return _star(
        one * 1_000_000 + two * 10 + three,
        [math.radians(ra), math.radians(dec), *motion],
        2000.0,
        parts[19],
    )


_ROWS: dict[str, Callable[[str], _Star | None]] = {
    "hip2": _hipparcos_row,
    "hip1": _first_hipparcos_row,
    "tyc2": _tycho_row,
}


def _star(ident: int, place: list[float], epoch: float, magnitude: str) -> _Star:
    ra, dec, pm_ra, pm_dec = place
    if not 0 < ident <= _LARGEST_IDENT:
        raise ValueError("the number of a star must be positive and of at most 10 digits")
    bright = float(magnitude)
    if not (_BRIGHTEST <= bright <= _FAINTEST and abs(pm_ra) + abs(pm_dec) <= _FASTEST_MAS):
        raise ValueError(
            f"star {ident} must have a magnitude and a motion of stars, got {bright:g} and "
            f"{pm_ra:g}, {pm_dec:g} mas/yr"
        )
    if not (0.0 <= ra <= math.tau and abs(dec) <= math.pi / 2):
        raise ValueError(f"star {ident} must stand on the sky, got {ra:g} and {dec:g} rad")
    return _Star(ident, ra, dec, pm_ra, pm_dec, epoch, bright)


def _moved(
    ra: Floats, dec: Floats, pm_ra_mas: Floats, pm_dec_mas: Floats, years: float | Floats
) -> Floats:
    """Unit vectors after uniform motion along the sky (ESA SP-1200, section 1.5.5, without radial
    velocity).
    """
    sin_ra, cos_ra, sin_dec, cos_dec = np.sin(ra), np.cos(ra), np.sin(dec), np.cos(dec)
    there = np.stack([cos_dec * cos_ra, cos_dec * sin_ra, sin_dec], axis=-1)
    east = np.stack([-sin_ra, cos_ra, np.zeros_like(ra)], axis=-1)
    north = np.stack([-sin_dec * cos_ra, -sin_dec * sin_ra, cos_dec], axis=-1)
    shift = (
        np.reshape(years, (-1, 1))
        * _RAD_PER_MAS
        * (pm_ra_mas[:, None] * east + pm_dec_mas[:, None] * north)
    )
    moved = there + shift
    return moved / np.linalg.norm(moved, axis=-1, keepdims=True)
