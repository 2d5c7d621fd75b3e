"""The small basis against a structure built anew with other films, joints and materials."""

import dataclasses

import numpy as np
import pytest

from losbench.thermoelastic.model import example_camera
from losbench.thermoelastic.reduced import ReducedHeat

TIME = np.array([0.0, 600.0, 900.0, 3000.0, 5400.0, 9000.0])
ROOM = {"room_degC": np.interp(TIME, [600.0, 5400.0], [18.0, 25.0])}


@pytest.fixture(scope="module")
def camera():
    return example_camera()


@pytest.fixture(scope="module")
def reduced(camera):
    return ReducedHeat.of(camera.heat, camera.heat_modes)


def field(heat, modes):
    drive = heat.drive(TIME, ROOM)
    return modes.amplitudes(TIME, drive) @ modes.shapes.T + drive.series @ modes.static.T


@pytest.mark.parametrize("scale", [(1, 1, 1), (1.4, 0.5, 1.5), (0.6, 2.0, 0.5)])
def test_other_films_and_feet(camera, reduced, scale):
    air, wall, feet = camera.loads
    loads = (
        dataclasses.replace(air, W_per_m2K=air.W_per_m2K * scale[0]),
        dataclasses.replace(wall, W_per_m2K=wall.W_per_m2K * scale[1]),
        dataclasses.replace(feet, W_per_K=feet.W_per_K * scale[2]),
    )
    rebuilt = dataclasses.replace(camera, loads=loads, modes=10**6)
    off = field(camera.heat, reduced.modes(scale)) - field(rebuilt.heat, rebuilt.heat_modes)
    assert np.abs(off).max() < 10e-3
    assert np.abs(camera.los_map[:4] @ off.T).max() < 1e-3


def test_other_conductivities_capacities_and_lags(camera, reduced):
    structure = camera.structure
    materials = {
        part: dataclasses.replace(
            m,
            conductivity_W_per_mK=m.conductivity_W_per_mK * 1.1,
            heat_J_per_kgK=m.heat_J_per_kgK * 0.95,
        )
        for part, m in structure.materials.items()
    }
    feet = dataclasses.replace(camera.loads[2], lag_s=camera.loads[2].lag_s * 1.3)
    rebuilt = dataclasses.replace(
        camera,
        structure=dataclasses.replace(structure, materials=materials),
        loads=(*camera.loads[:2], feet),
        modes=10**6,
    )
    slow = reduced.lagged(1.3)
    found = field(slow.heat, slow.modes(conduction=1.1, capacity=0.95))
    off = found - field(rebuilt.heat, rebuilt.heat_modes)
    assert np.abs(off).max() < 10e-3
    assert np.abs(camera.los_map[:4] @ off.T).max() < 1e-3


def test_factors_must_fit(reduced):
    with pytest.raises(ValueError, match=r"scale must have shape \(3,\) to match the loads"):
        reduced.modes([1.0, 2.0])
    with pytest.raises(ValueError, match="conduction must be positive"):
        reduced.modes(conduction=0.0)
