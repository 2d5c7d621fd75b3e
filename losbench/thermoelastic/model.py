"""A thermo-elastic camera from a TOML file, and the one that comes with losbench."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from losbench.checks import choice
from losbench.optics.threemirror import ThreeMirror
from losbench.parameters import from_table, read_toml
from losbench.resources import data_file
from losbench.thermoelastic.camera import ThermoelasticCamera
from losbench.thermoelastic.loads import Feet, Film, Flux, Load, Power, radiation
from losbench.thermoelastic.materials import MATERIALS, Material
from losbench.thermoelastic.shapes import Box, Face, Foot
from losbench.thermoelastic.structure import Structure

__all__ = ["MATERIAL_SETS", "example_camera", "orbit_loads", "read_camera_model"]

T = TypeVar("T")

MATERIAL_SETS = {
    "all aluminium": ("Al 6061", "Al 6061", "Al 6061", "Al 6061"),
    "aluminium + Zerodur": ("Al 6061", "Zerodur", "Si", "flexure"),
    "Invar + Zerodur": ("Invar 36", "Zerodur", "Si", "flexure"),
    "CFRP + Zerodur": ("CFRP", "Zerodur", "Si", "flexure"),
}
_LOADS: dict[str, type[Any]] = {"film": Film, "flux": Flux, "power": Power, "table": Feet}
_KEYS = {"reference_degC", "modes", "optics", "grid", "parts", "materials", "box", "hole", "faces"}
_KEYS |= {"feet", "sensors_mm", "inputs", "radiation", *_LOADS}


@dataclasses.dataclass(frozen=True)
class _Grid:
    cell_mm: float = 50.0
    x_mm: tuple[float, ...] = ()
    y_mm: tuple[float, ...] = ()
    z_mm: tuple[float, ...] = ()


@dataclasses.dataclass(frozen=True)
class _Radiation:
    emissivity: float
    mean_degC: float
    part: str | None = None
    side: str | None = None

    def __post_init__(self) -> None:
        """Check the values."""
        _linear(self)


def _linear(sky: _Radiation) -> Film:
    return radiation(sky.emissivity, sky.mean_degC, part=sky.part, side=sky.side)


def read_camera_model(path: str | Path) -> ThermoelasticCamera:
    """Read a thermo-elastic camera from a TOML file whose keys carry their units.

    Parameters
    ----------
    path : path
        ``data/three-mirror-camera.toml`` shows every table: ``[optics]``, ``[parts]``, ``[[box]]``,
        ``[[hole]]``, ``[faces.M1]``, ``[feet.A]``, ``[[film]]``, ``[[flux]]``, ``[[power]]``,
        ``[[table]]``, ``[[radiation]]``, ``[sensors_mm]``, ``[inputs]``, ``[materials.NAME]``.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        In one line that names file, part and key: a key that is missing, unknown or does not fit,
        boxes that overlap, a part that floats free or has no material, a beam that is cut, a mount
        that leaves a motion free.

    Examples
    --------
    >>> from losbench.resources import data_file
    >>> camera = read_camera_model(data_file("three-mirror-camera.toml"))
    >>> camera.structure.mesh.nelements, len(camera.structure.parts)
    (392, 10)
    """
    table, where = read_toml(path), str(path)
    if unknown := sorted(set(table) - _KEYS):
        raise ValueError(f"{where}: unknown key {unknown[0]}; known are {', '.join(sorted(_KEYS))}")
    for name in ("optics", "parts", "box", "faces", "feet"):
        if name not in table:
            raise ValueError(f"{where}: key {name} is missing")
    materials = dict(MATERIALS) | _named(Material, table, "materials", where)
    grid = from_table(_Grid, table.get("grid", {}), where=f"{where}: [grid]")
    parts = _table(table, "parts", where)
    for part, material in parts.items():
        with _at(f"{where}: [parts]"):
            choice(f"part {part!r}: material", material, materials)
    loads = [load for name, kind in _LOADS.items() for load in _listed(kind, table, name, where)]
    loads += [_linear(sky) for sky in _listed(_Radiation, table, "radiation", where)]
    boxes, holes = (tuple(_listed(Box, table, name, where)) for name in ("box", "hole"))
    feet, faces = _named(Foot, table, "feet", where), _named(Face, table, "faces", where)
    with _at(where):
        structure = Structure(
            boxes,
            {part: materials[material] for part, material in parts.items()},
            feet,
            faces,
            holes,
            {"x": grid.x_mm, "y": grid.y_mm, "z": grid.z_mm},
            grid.cell_mm,
        )
        camera = ThermoelasticCamera(
            structure,
            from_table(ThreeMirror, _table(table, "optics", where), where="[optics]"),
            tuple(loads),
            _table(table, "sensors_mm", where),
            inputs=_table(table, "inputs", where),
            **{key: table[key] for key in ("reference_degC", "modes") if key in table},
        )
        camera.check()
    return camera


def example_camera(
    materials: str = "aluminium + Zerodur", *, loads: tuple[Load, ...] | None = None
) -> ThermoelasticCamera:
    """Return the camera of ``data/three-mirror-camera.toml``, of one of the `MATERIAL_SETS`.

    Parameters
    ----------
    materials : str
        Bench, mirrors, detector and pads.
    loads : tuple of Load, optional
        In place of the room and the table, for instance `orbit_loads`.

    Raises
    ------
    ValueError
        If there is no such set.

    Examples
    --------
    >>> sorted(example_camera("all aluminium").heat.inputs)
    ['room_degC']
    """
    choice("materials", materials, MATERIAL_SETS)
    camera = read_camera_model(data_file("three-mirror-camera.toml"))
    bench, mirror, detector, pad = MATERIAL_SETS[materials]
    kinds = {"M1": mirror, "M2": mirror, "M3": mirror, "FP": detector, "pads": pad}
    structure = dataclasses.replace(
        camera.structure,
        materials={part: MATERIALS[kinds.get(part, bench)] for part in camera.structure.parts},
    )
    return dataclasses.replace(camera, structure=structure, loads=loads or camera.loads)


def orbit_loads(*, emissivity: float, mean_degC: float = 20.0) -> tuple[Load, ...]:
    """Loads of the example camera in orbit.

    Sun on the +x wall and Earth on the bench's side, both through insulation that lets 5 % in,
    electronics in the focal plane, and radiation to space; the feet carry no heat. Inputs are
    ``sun_W_per_m2``, ``earth_W_per_m2`` and ``electronics_W``.

    Parameters
    ----------
    emissivity : float
        Of all outside faces, insulation included; no material's own. 0.029 balances 20 degC in the
        mean under a half sine of 1361 W/m2, 230 W/m2 from Earth, and 3 W for a third of a
        revolution, 1 W for the rest.
    mean_degC : float
        Where radiation is linearised; it should be near what the balance gives. In the orbit above,
        parts from 18 to 38 degC, it costs 0.014 K and 4e-4 px against the law of T^4.

    Examples
    --------
    >>> [load.input for load in orbit_loads(emissivity=0.029)][:3]
    ['sun_W_per_m2', 'earth_W_per_m2', 'electronics_W']
    """
    return (
        Flux("sun_W_per_m2", 0.05, "wall+", "+x"),
        Flux("earth_W_per_m2", 0.05, "bench", "-y"),
        Power("electronics_W", "FP"),
        radiation(emissivity, mean_degC),
    )


def _table(table: Mapping[str, Any], name: str, where: str) -> dict[str, Any]:
    value = table.get(name, {})
    if not isinstance(value, dict):
        raise ValueError(f"{where}: {name} must be a table, [{name}], got {value!r}")
    return value


def _named(kind: type[T], table: Mapping[str, Any], name: str, where: str) -> dict[str, T]:
    """Return the tables [name.KEY] by their keys."""
    return {
        key: from_table(kind, value, where=f"{where}: [{name}.{key}]")
        for key, value in _table(table, name, where).items()
    }


def _listed(kind: type[T], table: Mapping[str, Any], name: str, where: str) -> list[T]:
    """Return the tables [[name]], numbered from 1 in messages."""
    values = table.get(name, [])
    if not isinstance(values, list):
        raise ValueError(f"{where}: {name} must be a list of tables, [[{name}]], got {values!r}")
    found = []
    for k, value in enumerate(values):
        of = f" (part {value['part']!r})" if isinstance(value, dict) and "part" in value else ""
        found.append(from_table(kind, value, where=f"{where}: {name} {k + 1}{of}"))
    return found


@contextmanager
def _at(where: str) -> Iterator[None]:
    """Begin the messages of ValueErrors with ``where``."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None
