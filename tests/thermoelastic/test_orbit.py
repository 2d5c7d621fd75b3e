"""The orbit's heat: what goes in comes out, and radiation along a line against the law of T^4."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.constants import Stefan_Boltzmann, zero_Celsius
from scipy.sparse import diags_array
from scipy.sparse.linalg import splu

from losbench.thermoelastic.heat import Heat
from losbench.thermoelastic.loads import Power, radiation
from losbench.thermoelastic.materials import MATERIALS
from losbench.thermoelastic.model import example_camera, orbit_loads
from losbench.thermoelastic.shapes import Box, Foot
from losbench.thermoelastic.structure import Structure

PERIOD_S, EMISSIVITY = 5400.0, 0.029
MEAN = {"sun_W_per_m2": 1361.0 / np.pi, "earth_W_per_m2": 230.0, "electronics_W": 5.0 / 3.0}


@pytest.fixture(scope="module")
def camera():
    return example_camera(loads=orbit_loads(emissivity=EMISSIVITY))


def sent(heat, inputs):
    """Watts that each drive puts in, and the steady temperatures under them all."""
    values = [inputs.get(name, name) for name, _ in heat.drives]
    return heat.gain.sum(axis=0) * values, heat.steady @ values


def bare_area_m2(structure, part=None, side=None):
    """Area of outside faces by their corners alone."""
    mesh = structure.mesh
    span = np.ptp(mesh.p[:, mesh.facets[:, structure.facets(part, side)]], axis=1)
    return np.prod(np.where(span > 0, span, 1.0), axis=0).sum() * 1e-6


def settle(linear, emitted, power, kelvin):
    """Solve linear T + emitted(T) = power with one slope, that of a body at 20 degC."""
    slope = emitted(np.full(len(power), 293.16)) - emitted(np.full(len(power), 293.14))
    factor = splu((linear + diags_array(slope / 0.02)).tocsc())
    for _ in range(100):
        step = factor.solve(linear @ kelvin + emitted(kelvin) - power)
        kelvin = kelvin - step
        if np.abs(step).max() < 1e-9:
            return kelvin
    raise AssertionError("did not settle")


def law(heat):
    """Return conduction, and what vertices (n,) in kelvin emit, watts, by T^4."""
    sky = heat.loads[-1].assemble(heat.structure)[0]
    emitting = sky * (EMISSIVITY * Stefan_Boltzmann / heat.loads[-1].W_per_m2K)
    return heat.loss - sky, lambda kelvin: emitting @ kelvin**4


def stepped(heat, conduction, emitted, power, step_s):
    """Temperatures (n, vertices) in degC from the steady state of the first powers (Crank, Nicolson)."""
    kelvin = [settle(conduction, emitted, power[0], np.full(power.shape[1], 293.15))]
    storing = heat.capacity * (2.0 / step_s)
    for first, last in pairwise(power):
        old = kelvin[-1]
        held = storing @ old - conduction @ old - emitted(old) + first + last
        kelvin.append(settle(storing + conduction, emitted, held, old))
    return np.array(kelvin) - zero_Celsius


def test_what_sun_earth_and_electronics_send_is_what_is_radiated(camera):
    heat, structure = camera.heat, camera.structure
    watts, steady = sent(heat, MEAN)
    sun = 0.05 * MEAN["sun_W_per_m2"] * bare_area_m2(structure, "wall+", "+x")
    earth = 0.05 * 230.0 * bare_area_m2(structure, "bench", "-y")
    np.testing.assert_allclose(watts[:3], [sun, earth, MEAN["electronics_W"]], rtol=1e-12)
    loss, gain = heat.loads[-1].assemble(structure)
    radiated = (loss @ steady).sum() - gain.sum() * heat.loads[-1].input
    assert radiated == pytest.approx(watts[:3].sum(), rel=1e-11)
    # Each vertex by itself, too, and conduction makes no heat.
    left = heat.loss @ steady - heat.gain @ [MEAN.get(name, name) for name, _ in heat.drives]
    assert np.abs(left).max() < 1e-11 * watts[:3].sum()
    np.testing.assert_allclose((heat.loss - loss).sum(axis=0), 0.0, atol=1e-12)


def test_heat_that_is_stored_is_what_came_less_what_went(camera):
    """Over any stretch: joules in the body against integrals of the loads, by Simpson's rule."""
    heat = camera.heat
    time = np.linspace(0.0, 1000.0, 2001)
    drive = heat.drive(time, {**MEAN, "electronics_W": np.interp(time, [0, 1000], [1.0, 3.0])})
    modes = heat.modes(10**6)
    field = modes.amplitudes(time, drive) @ modes.shapes.T + drive.series @ modes.static.T
    stored = (heat.capacity @ (field[-1] - field[0])).sum()
    flow = drive.series @ heat.gain.sum(axis=0) - field @ np.asarray(heat.loss.sum(axis=0))
    weight = np.tile([2.0, 4.0], 1001)[:-1]
    weight[[0, -1]] = 1.0
    assert stored > 100.0
    # What LAPACK leaves of the slowest rate, beside the fastest: 5e-7 at most, 1e-8 or 2e-8 as found.
    rates = modes.rates_per_s
    rounding = rates.size * np.finfo(float).eps * rates.max() / rates.min()
    assert rounding < 1e-6
    assert stored == pytest.approx(weight @ flow * (time[1] - time[0]) / 3, rel=rounding)


def test_the_emissivity_that_balances_twenty_degrees(camera):
    """The number of the docstring: in the mean over a revolution, by T^4 and the bare area."""
    watts = sent(camera.heat, MEAN)[0][:3].sum()
    balance = watts / (bare_area_m2(camera.structure) * Stefan_Boltzmann * 293.15**4)
    assert 0.0285 < balance < 0.0295
    power = camera.heat.gain[:, :3] @ list(MEAN.values())
    mean = settle(*law(camera.heat), power, np.full(power.size, 293.15))
    assert mean.mean() - zero_Celsius == pytest.approx(20.0, abs=1.0)


@pytest.mark.parametrize(
    ("apart_K", "low", "high"), [(5, 0.125, 0.135), (-10, 0.45, 0.51), (10, 0.5, 0.53)]
)
def test_radiation_along_a_line_is_too_warm_by_the_square(apart_K, low, high):
    """The numbers of the docstring, on a body so small that it has one temperature."""
    feet = {"A": Foot((0, 0, 0), "xyz"), "B": Foot((0, 0, 9), "xy"), "C": Foot((9, 0, 0), "y")}
    block = Structure((Box("cube", (0, 0, 0), (9, 9, 9)),), {"cube": MATERIALS["Al 6061"]}, feet)
    heat = Heat(block, (Power("chip_W", "cube"), radiation(0.3, 20.0)))
    watts = 6 * 81e-6 * 0.3 * Stefan_Boltzmann * (293.15 + apart_K) ** 4
    found = sent(heat, {"chip_W": watts})[1].mean() - 20.0
    assert low < found - apart_K < high
    assert found - apart_K == pytest.approx(1.5 * apart_K**2 / 293.15, rel=0.03)


@pytest.fixture(scope="module")
def orbit():
    """A revolution after a steady start: sun as half a sine, electronics 3 W for a third of it."""
    time = np.arange(0.0, PERIOD_S + 1, 60.0)
    phase = (time - 60.0) % PERIOD_S
    inputs = {
        "sun_W_per_m2": 1361.0 * np.maximum(np.sin(2 * np.pi * phase / PERIOD_S), 0.0),
        "earth_W_per_m2": np.full(time.size, 230.0),
        "electronics_W": np.where(phase < PERIOD_S / 3, 3.0, 1.0),
    }
    for name, series in inputs.items():
        series[0] = MEAN[name]
    return time, inputs


def test_an_orbit_by_the_line_and_by_t4(camera, orbit):
    """The numbers of the docstring; law and tangent stepped alike, so that steps cancel."""
    time, inputs = orbit
    heat, sky, step_s = camera.heat, camera.loads[-1], time[1] - time[0]
    power = np.stack(list(inputs.values()), axis=-1) @ heat.gain[:, :3].T
    conduction, by_t4 = law(heat)
    loss, gain = sky.assemble(camera.structure)
    offset = gain * (sky.input + zero_Celsius)
    tangent = stepped(heat, conduction, lambda kelvin: loss @ kelvin - offset, power, step_s)
    off = tangent - stepped(heat, conduction, by_t4, power, step_s)
    line, sight = camera.temperatures(time, inputs), camera.los_map[:4].T
    assert 17.5 < line.min() < 18.5
    assert 37.5 < line.max() < 38.5
    assert 0.013 < np.abs(off).max() < 0.015
    assert 3e-4 < np.abs(off @ sight).max() < 5e-4
    assert np.abs((tangent - line) @ sight).max() < 0.01  # and both are the camera's own run


def test_loads_that_jump_cost_the_slow_modes_more_than_a_room_does(camera, orbit):
    """The number of the docstring: the sun goes out within 15 s, and the fast modes lag."""
    inputs = {name: series[[1, 1]] for name, series in orbit[1].items()}
    inputs["sun_W_per_m2"] = np.array([433.0, 0.0])
    runs = [
        each.simulate([0.0, 15.0], inputs).px for each in (camera, replace(camera, modes=10**6))
    ]
    assert 0.003 < np.abs(runs[0] - runs[1]).max() < 0.006
