"""The whole chain: against rays, against all modes, against an independent prototype; and bad models."""

import dataclasses
import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from losbench.optics.design import design_three_mirror
from losbench.resources import data_file
from losbench.thermoelastic.model import (
    MATERIAL_SETS,
    example_camera,
    orbit_loads,
    read_camera_model,
)
from losbench.units import rad_to_arcsec

TIME = np.arange(0.0, 9001.0, 25.0)
ROOM = {"room_degC": np.interp(TIME, [600.0, 5400.0], [18.0, 25.0])}
# Drift of alpha and beta, arcsec, and of focus, um, over the warm-up; steady alpha per degree.
PROTOTYPE = {
    "all aluminium": (0.86, 0.25, 1.5, 0.0),
    "aluminium + Zerodur": (2.22, 0.25, 92.6, -0.316),
    "Invar + Zerodur": (0.71, 0.13, 6.7, -0.047),
    "CFRP + Zerodur": (0.57, 0.03, 3.8, -0.063),
}


@pytest.fixture(scope="module")
def camera():
    return example_camera()


@pytest.fixture(scope="module")
def run(camera):
    return camera.simulate(TIME, ROOM)


@pytest.mark.parametrize("materials", MATERIAL_SETS)
def test_four_material_sets_drift_as_the_prototype_found(materials):
    alpha, beta, focus, steady = PROTOTYPE[materials]
    camera = example_camera(materials)
    run = camera.simulate(TIME, ROOM)
    drift = rad_to_arcsec(np.ptp(run.angles_rad, axis=0))
    assert drift[0] == pytest.approx(alpha, abs=0.05)
    assert drift[1] == pytest.approx(beta, abs=0.02)
    assert np.ptp(run.focus_um, axis=0) == pytest.approx(focus, rel=0.02)
    assert rad_to_arcsec(camera.steady_rad_per_degC)[0] == pytest.approx(steady, abs=0.01)


def test_the_adjoint_is_the_forward_map(camera):
    rise = np.random.default_rng(0).normal(size=camera.structure.mesh.nvertices)
    moved = camera.displace(rise + camera.reference_degC)
    forward = camera.elasticity.motion_rows(camera.optics.pivot_mm) @ moved.ravel()
    np.testing.assert_allclose(
        camera.motion_map @ rise, forward, rtol=0, atol=1e-11 * np.abs(forward).max()
    )


def test_the_map_is_what_rays_say(camera, run):
    temperature = camera.temperatures(TIME, ROOM)[::40]
    px, focus_um = camera.trace(temperature)
    np.testing.assert_allclose(run.px[::40], px, atol=1e-3)
    np.testing.assert_allclose(run.focus_um[::40], focus_um, atol=3e-3)


def test_slow_modes_and_statics_are_nearly_all_modes(camera, run):
    full = dataclasses.replace(camera, modes=10**6)
    exact = full.simulate(TIME, ROOM)
    np.testing.assert_allclose(run.px, exact.px, atol=1e-4)
    np.testing.assert_allclose(
        camera.temperatures(TIME, ROOM), full.temperatures(TIME, ROOM), atol=1e-3
    )
    coarse = dataclasses.replace(camera, modes=20).simulate(TIME, ROOM)
    assert np.abs(coarse.px - exact.px).max() > 1e-4  # the bound is not idle


def test_a_camera_in_equilibrium_stays_where_it_is(camera):
    run = camera.simulate([0.0, 100.0, 5000.0], {"room_degC": 18.0})
    np.testing.assert_allclose(run.px, np.broadcast_to(camera.optics.observe()[0], run.px.shape))
    np.testing.assert_allclose(run.angles_rad, 0.0, atol=1e-15)
    np.testing.assert_allclose(run.temperature_degC, 18.0, atol=1e-9)


def test_sensors_read_the_field(camera, run):
    field = camera.temperatures(TIME, ROOM)
    np.testing.assert_allclose(run.temperature_degC, field[:, list(camera.sensor_nodes)], atol=1e-9)
    wall = camera.structure.mesh.p[:, camera.sensor_nodes[0]]
    assert wall[0] == 55.0  # on the wall that was meant


def test_angles_are_those_that_spots_in_the_pinhole_give(camera, run):
    from losbench.pointing.attitude import solve_attitude

    pinhole, rest = camera.optics.pinhole, camera.optics.observe()[0]
    fit = solve_attitude(
        pinhole.points_mm(rest), (run.px - rest) * pinhole.pixel_mm, method="ls"
    ).angles
    bias = Rotation.from_euler("x", camera.optics.bias_deg, degrees=True)
    turned = bias.apply(fit)
    np.testing.assert_allclose(run.angles_rad, turned, atol=1e-12)


@pytest.mark.slow
def test_a_finer_mesh_moves_the_small_uniform_answer_by_four_percent_and_gradients_hardly(
    camera, run
):
    fine = dataclasses.replace(
        camera, structure=dataclasses.replace(camera.structure, cell_mm=15.0)
    )
    finer = fine.simulate(TIME, ROOM)
    alpha, focus = (
        np.ptp(getattr(finer, name), axis=0)[0] / np.ptp(getattr(run, name), axis=0)[0]
        for name in ("angles_rad", "focus_um")
    )
    assert 0.95 < alpha < 0.97
    assert 0.985 < focus < 0.995
    gradients = [each.los_map[0] @ each.structure.mesh.p[0] for each in (camera, fine)]
    assert gradients[1] == pytest.approx(gradients[0], rel=1e-3)


def test_an_orbit_warms_the_sunny_side():
    camera = example_camera(loads=orbit_loads(emissivity=0.03))
    assert sorted(camera.heat.inputs) == ["earth_W_per_m2", "electronics_W", "sun_W_per_m2"]
    time = np.linspace(0.0, 3 * 5400.0, 500)
    sun = 1361.0 * np.maximum(np.sin(2 * np.pi * time / 5400.0), 0.0)
    run = camera.simulate(
        time, {"sun_W_per_m2": sun, "earth_W_per_m2": 230.0, "electronics_W": 1.0}
    )
    plus, minus = run.temperature_degC[-100:, :2].T
    assert (plus - minus).max() > 0.05


def test_a_design_of_ones_own_goes_into_the_same_body(camera):
    own = dataclasses.replace(camera, optics=design_three_mirror())
    np.testing.assert_allclose(own.los_map, camera.los_map, rtol=0.02, atol=2e-4)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('M2 = "Zerodur"\n', "", r"part 'M2' has no key in materials"),
        ('M2 = "Zerodur"', 'M2 = "glass"', r"\[parts\]: part 'M2': material must be one of"),
        ("high_mm = [12.0, 11.0, 157.0]", "high_mm = [12.0, 11.0, 166.0]",
            r"box 14: part 'M2' overlaps part 'front'; if that is meant, give it the key replaces"),
        ("low_mm = [-12.0, -11.0, 157.0]", "low_mm = [-12.0, -11.0, 158.0]",
            "part 'M2' floats free: its boxes share no face with the body; check low_mm and high_mm"),
        ("high_mm = [55.0, 17.0, 172.0]", "high_mm = [55.0, 70.0, 172.0]",
            "box 5: part 'front' cuts the beam on its way to M1; change its low_mm or high_mm"),
        ('held = "xy"', 'held = "x"', "feet: the keys held of A, B, C leave the body free to"),
        ("conic = [-1.6168, 0.0, 0.1954]\n", "", r"\[optics\]: key conic is missing"),
        ("young_MPa", "young_MPa", None),
        ("beam_mm = 40.0", "beam_cm = 4.0", r"\[optics\]: unknown key beam_cm; known are"),
        ("W_per_m2K = 4.0", 'W_per_m2K = "a"', r"film 2 \(part 'wall\+'\): W_per_m2K must be a number"),
        ('side = "+x"', 'side = "up"', "film: side must be one of '-x', '\\+x'"),
        ("[sensors_mm]", "[sensor_mm]", "unknown key sensor_mm; known are"),
        ("z_mm = 148.6\n", "z_mm = 150.0\n", "faces: M2 must lie on the outside of the body: at z_mm = 150 only 0 mm2"),
        ("[feet.C]\nmm = [55.0", "[feet.C]\nmm = [57.0", r"feet: C: there is no material at \[57.0"),
        ("[[table]]", "[inputs]\nsun = 1.0\n\n[[table]]", "inputs: no load asks for sun"),
        ("[faces.M1]", "[face.M1]", "unknown key face; known are"),
        ("rear = [0.0, 35.0,", "rear = [0.0, 350.0,", r"sensors_mm: rear must lie on the body, got \[0.0, 350.0, -30.0\], 275 mm off"),
        ('held = "xyz"', 'held = "w"', r"toml: \[feet.A\]: held must be letters of 'xyz', got 'w'"),
        ('[[box]]\npart = "bench"\n', "[[box]]\n", "toml: box 1: key part is missing"),
        ('part = "FP"\n', 'part = "FP"\nreplaces = "front"\n', r"box 18 \(part 'FP'\): replaces of part 'FP' must be a list of parts"),
        ('part = "FP"\n', 'part = "FP"\nreplaces = ["lid"]\n', "box 18: replaces must be one of 'bench', .* got 'lid'"),
        ("[[table]]", '[inputs]\nroom_degC = "warm"\n\n[[table]]', "inputs: room_degC must be a number"),
        ("[[table]]", '[[power]]\ninput = true\npart = "FP"\n\n[[table]]', r"power 1 \(part 'FP'\): input, if it is not a name, must be a number"),
        ("[[table]]", '[[power]]\ninput = [1]\npart = "FP"\n\n[[table]]', r"power 1 \(part 'FP'\): input, if it is not a name, must be"),
        ("[[table]]", '[[power]]\ninput = ""\npart = "FP"\n\n[[table]]', r"power 1 \(part 'FP'\): input must be a name or a number"),
        ("[[table]]", "[[radiation]]\nemissivity = 2.0\nmean_degC = 20.0\n\n[[table]]", "toml: radiation 1: emissivity must be a finite number from 0 to 1"),
        ("reference_degC = 18.0", "reference_degC = 'warm'", "reference_degC must be a number"),
    ],
)  # fmt: skip
def test_a_bad_model_is_refused_in_one_line_by_part_and_key(tmp_path, old, new, said):
    path = tmp_path / "camera.toml"
    text = data_file("three-mirror-camera.toml").read_text(encoding="utf-8")
    if said is None:  # a material of one's own, with units in its keys
        own = (
            "[materials.glass]\nyoung_MPa = 70000\npoisson = 0.2\nexpansion_per_K = 5e-7\n"
            "conductivity_W_per_mK = 1.4\ndensity_kg_per_m3 = 2200\nheat_J_per_kgK = 770\n"
        )
        path.write_text(text.replace('M2 = "Zerodur"', 'M2 = "glass"') + own, encoding="utf-8")
        assert read_camera_model(path).structure.materials["M2"].young_MPa == 70000
        return
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ValueError, match=said) as refusal:
        read_camera_model(path)
    message = str(refusal.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    assert len(re.findall(re.escape(str(path)), message)) == 1


def test_what_the_model_shows_in_comments_can_be_read(tmp_path):
    text = data_file("three-mirror-camera.toml").read_text(encoding="utf-8")
    body, more = text.split('take the "# " away. Faces and feet without a load pass no heat.\n')
    path = tmp_path / "camera.toml"
    path.write_text(body + "\n" + re.sub("^# ?", "", more, flags=re.MULTILINE), encoding="utf-8")
    camera = read_camera_model(path)
    assert camera.inputs == {"sun_W_per_m2": 0.0, "electronics_W": 1.0}
    assert [type(load).__name__ for load in camera.loads] == [
        "Film",
        "Film",
        "Flux",
        "Power",
        "Feet",
        "Film",
    ]


def test_a_model_whose_heat_cannot_leave_is_refused(tmp_path):
    path = tmp_path / "camera.toml"
    text = data_file("three-mirror-camera.toml").read_text(encoding="utf-8")
    only = '[[power]]\ninput = "chip_W"\npart = "FP"\n'
    path.write_text(text[: text.index("[[film]]")] + only, encoding="utf-8")
    with pytest.raises(ValueError, match="camera.toml: loads must lose heat somewhere"):
        read_camera_model(path)


def test_no_file_no_model(tmp_path):
    with pytest.raises(FileNotFoundError, match="no TOML file at"):
        read_camera_model(tmp_path / "none.toml")
    with pytest.raises(ValueError, match="materials must be one of"):
        example_camera("cheese")
