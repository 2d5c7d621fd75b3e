"""Authority: a cooled bar and a lag in closed form, the lumped network, and where watts go."""

import numpy as np
import pytest
from scipy.constants import Stefan_Boltzmann
from scipy.optimize import brentq

import losbench as lb
from losbench.thermoelastic.heat import Heat, ramps
from losbench.thermoelastic.loads import Feet, Film, Flux, Power, radiation
from losbench.thermoelastic.materials import MATERIALS
from losbench.thermoelastic.shapes import Box, Foot
from losbench.thermoelastic.structure import Structure

AL, SIC = MATERIALS["Al 6061"], MATERIALS["SiC"]


def bar(x=10.0, y=10.0, z=100.0, material=AL, **more):
    feet = {"A": Foot((0, 0, 0), "xyz"), "B": Foot((0, 0, z), "xy"), "C": Foot((x, 0, 0), "y")}
    return Structure((Box("bar", (0, 0, 0), (x, y, z)),), {"bar": material}, feet, **more)


def cooled_bar(biot, fourier, place, terms=200):
    """Share of the step that is left at place/length, after Fourier times (Carslaw and Jaeger 3.10)."""
    roots = np.array(
        [
            brentq(lambda q: q * np.sin(q) - biot * np.cos(q), n * np.pi + 1e-12, (n + 0.5) * np.pi)
            for n in range(terms)
        ]
    )
    weight = 4 * np.sin(roots) / (2 * roots + np.sin(2 * roots))
    return (weight * np.cos(roots * place) * np.exp(-(roots**2) * fourier[:, None])).sum(axis=1)


@pytest.mark.parametrize(("cells", "error"), [(5, 4e-3), (10, 1e-3), (20, 2.5e-4)])
def test_a_bar_cooled_at_one_end(cells, error):
    length, biot = 100.0, 0.952
    film = biot * AL.conductivity_W_per_mK / (length * 1e-3)
    heat = Heat(bar(cell_mm=length / cells), (Film("air", film, side="+z"),))
    diffusivity = AL.conductivity_W_per_mK / (AL.density_kg_per_m3 * AL.heat_J_per_kgK) * 1e6
    fourier = np.linspace(0.05, 2.0, 40)
    time = np.concatenate([[0.0, 1e-6], fourier * length**2 / diffusivity])
    air = np.append(0.0, np.ones(41))
    modes = heat.modes(10**6)
    drive = heat.drive(time, {"air": air})
    found = modes.amplitudes(time, drive) @ modes.shapes.T + drive.series @ modes.static.T
    for place in (0.0, 0.4, 1.0):
        node = heat.structure.node_at("probe", (0, 0, place * length))
        left = 1.0 - found[2:, node]
        assert np.abs(left - cooled_bar(biot, fourier, place)).max() < error


def test_a_small_body_is_a_node_of_the_network():
    block = bar(10, 10, 20, SIC)
    film, area, volume = 12.0, (4 * 200 + 200) * 1e-6, 2000e-9
    network = lb.ThermalNetwork(
        {"block": SIC.density_kg_per_m3 * SIC.heat_J_per_kgK * volume}, {}, {"block": film * area}
    )
    time = np.array([0.0, 30.0, 100.0, 400.0, 1000.0])
    room = np.array([18.0, 18.0, 21.0, 25.0, 25.0])
    heat = Heat(block, (Film("room", film),))
    drive = heat.drive(time, {"room": room})
    modes = heat.modes(5)
    found = modes.amplitudes(time, drive) @ modes.shapes.T + drive.series @ modes.static.T
    np.testing.assert_allclose(found.mean(axis=1), network.simulate(time, room)[:, 0], atol=2e-3)


def test_watts_go_where_they_are_sent():
    block = bar(10, 20, 100)
    walls = [200, 1000, 2000]
    for side, area in zip("zyx", walls, strict=True):
        loss, gain = Film("air", 7.0, side=f"+{side}").assemble(block)
        assert gain.sum() == pytest.approx(7.0 * area * 1e-6)
        np.testing.assert_allclose(loss.sum(axis=0), gain)
        assert Flux("sun", 0.3, side=f"-{side}").assemble(block)[1].sum() == pytest.approx(
            0.3 * area * 1e-6
        )
    assert Power("chip", "bar").assemble(block)[1].sum() == pytest.approx(1.0)
    assert Feet("table", 0.05).assemble(block)[1].sum() == pytest.approx(0.15)
    mass = AL.density_kg_per_m3 * 2e-5
    heat = Heat(block, (Film("air", 7.0), Power("chip", "bar")))
    assert heat.capacity.sum() == pytest.approx(mass * AL.heat_J_per_kgK)
    # All the watts leave through the film in the end.
    assert heat.steady[:, 1].mean() * 7.0 * 2 * sum(walls) * 1e-6 == pytest.approx(1.0, rel=1e-3)
    np.testing.assert_allclose(heat.steady[:, 0], 1.0, rtol=1e-12)


def test_conduction_along_a_rod():
    """One watt between ends: the drop is length / (k area)."""
    rod = bar(10, 10, 100, cell_mm=10)
    heat = Heat(rod, (Film(0.0, 1e4, side="-z"), Flux("sun", side="+z")))
    steady = heat.steady[:, 1] / 1e-4  # per watt on 100 mm2
    z = rod.mesh.p[2]
    drop = np.ptp(steady[(z == 0) | (z == 100)])
    assert drop == pytest.approx(0.1 / (AL.conductivity_W_per_mK * 1e-4), rel=1e-9)


def test_radiation_is_the_tangent_of_the_fourth_power():
    film = radiation(0.5, 20.0)

    def lost(degC):
        return film.W_per_m2K * (degC - film.input)

    def true(degC):
        return 0.5 * Stefan_Boltzmann * (degC + 273.15) ** 4

    assert lost(20.0) == pytest.approx(true(20.0), rel=1e-12)
    assert lost(21.0) - lost(19.0) == pytest.approx(true(21.0) - true(19.0), rel=2e-5)


def test_a_lag_of_a_ramp_in_closed_form():
    time = np.array([0.0, 3.0, 10.0, 11.0, 50.0])
    found = ramps(time, np.array([0.2]), 0.2 * time[:, None], np.zeros(1))[:, 0]
    np.testing.assert_allclose(found, time - 5.0 * (1 - np.exp(-time / 5.0)), atol=1e-13)


def test_steps_of_any_length_give_the_same_run():
    heat = Heat(bar(), (Film("air", 10.0), Feet("air", 0.1, 600.0)))
    fine = np.arange(0.0, 2001.0, 10.0)
    coarse = np.array([0.0, 500.0, 510.0, 2000.0])
    air = [0.0, 5.0, 5.0, 5.0]
    modes = heat.modes(10)
    runs = []
    for time in (fine, coarse):
        drive = heat.drive(time, {"air": np.interp(time, coarse, air)})
        runs.append((drive.series, modes.amplitudes(time, drive)))
    chosen = [0, 50, 51, 200]
    np.testing.assert_allclose(runs[0][0][chosen], runs[1][0], atol=1e-12)
    np.testing.assert_allclose(runs[0][1][chosen], runs[1][1], atol=1e-9)


def test_a_lag_as_slow_as_a_mode_is_no_special_case():
    """Where both rates agree the kernel is t exp(-rate t): the limit of its neighbours."""
    block = bar(10, 10, 20, SIC)
    slowest = 1.0 / Heat(block, (Film("air", 10.0),)).modes(1).rates_per_s[0]
    time, air = np.array([0.0, 1e-3, 500.0]), [0.0, 1.0, 1.0]
    found = []
    for factor in (1.0, 1.0 + 1e-6, 1.0 - 1e-6):
        heat = Heat(block, (Film("air", 10.0, lag_s=slowest * factor),))
        found.append(heat.modes(1).amplitudes(time, heat.drive(time, {"air": air}))[-1, 0])
    assert found[0] == pytest.approx(np.mean(found[1:]), rel=1e-9)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Heat(bar(), ()), "loads must hold at least one"),
        (lambda: Heat(bar(), (Power("chip", "bar"),)).modes(), "loads must lose heat somewhere"),
        (lambda: Film("air", -1.0), "W_per_m2K must not be negative"),
        (lambda: Flux("sun", 1.5), "absorbed must be a finite number from 0 to 1"),
        (lambda: Feet("table", 0.1, -1.0), "lag_s must not be negative"),
        (lambda: Power("chip", "board").assemble(bar()), "part must be one of bar, got 'board'"),
        (lambda: Film("air", 1.0, "lid").assemble(bar()), "part must be one of 'bar', got 'lid'"),
        (lambda: radiation(2.0, 20.0), "emissivity must be a finite number from 0 to 1"),
    ],
)
def test_loads_that_cannot_be_are_refused(make, said):
    with pytest.raises(ValueError, match=said):
        make()


@pytest.mark.parametrize(
    ("inputs", "said"),
    [
        ({}, "inputs must give air; air is missing"),
        ({"air": 1.0, "sun": 2.0}, "inputs must be of air, got sun"),
        ({"air": [1.0, 2.0]}, r"inputs\['air'\] must have shape \(3,\) to match time_s"),
    ],
)
def test_inputs_that_do_not_fit_are_refused(inputs, said):
    with pytest.raises(ValueError, match=said):
        Heat(bar(), (Film("air", 10.0),)).drive(np.arange(3.0), inputs)
