"""Authority: what heat does to bars, plates and bimetals in closed form; every bad model by name."""

import dataclasses

import numpy as np
import pytest

from losbench.optics.jacobian import los_jacobian
from losbench.optics.rays import Rays
from losbench.optics.threemirror import ThreeMirror
from losbench.thermoelastic.elastic import Elasticity
from losbench.thermoelastic.materials import MATERIALS, Material
from losbench.thermoelastic.shapes import Box, Face, Foot
from losbench.thermoelastic.structure import Structure

AL, INVAR = MATERIALS["Al 6061"], MATERIALS["Invar 36"]
OPTICS = ThreeMirror(
    radius_mm=(542.46, 171.93, 251.7),
    conic=(-1.6168, 0.0, 0.1954),
    vertex_z_mm=(0.0, 148.6, 0.0, 176.91),
    beam_mm=40.0,
    bias_deg=6.0,
    pixel_um=10.0,
    shape=(1080, 1920),
)


def feet(x, z):
    """Three feet that hold a body of corner (0, 0, 0) and nothing else."""
    return {"A": Foot((0, 0, 0), "xyz"), "B": Foot((0, 0, z), "xy"), "C": Foot((x, 0, 0), "y")}


def brick(x, y, z, material=AL, **more):
    return Structure((Box("bar", (0, 0, 0), (x, y, z)),), {"bar": material}, feet(x, z), **more)


def up_to_a_rigid_motion(moved, expected, places):
    """Largest difference that no shift and turn explains."""
    x, y, z = places.T
    zero, one = np.zeros_like(x), np.ones_like(x)
    rigid = np.array(
        [
            (one, zero, zero),
            (zero, one, zero),
            (zero, zero, one),
            (zero, -z, y),
            (z, zero, -x),
            (-y, x, zero),
        ]
    )
    rigid = rigid.transpose(2, 1, 0).reshape(-1, 6)
    off = (moved - expected).ravel()
    return np.abs(off - rigid @ np.linalg.lstsq(rigid, off, rcond=None)[0]).max()


def test_a_free_bar_grows():
    bar = Elasticity(brick(10, 20, 100, cell_mm=20))
    moved = bar.displace(np.full(bar.structure.mesh.nvertices, 10.0))
    np.testing.assert_allclose(moved, 10 * AL.expansion_per_K * bar.nodes_mm, atol=1e-12)


def test_a_plate_with_a_gradient_bends_to_a_sphere():
    """T = g z leaves a free body without stress: u_z = alpha g (z^2 - x^2 - y^2) / 2."""
    plate = Elasticity(brick(60, 80, 5, cell_mm=20))
    gradient = 2.0
    moved = plate.displace(gradient * plate.structure.mesh.p[2])
    x, y, z = plate.nodes_mm.T
    expected = AL.expansion_per_K * gradient * np.array([x * z, y * z, (z**2 - x**2 - y**2) / 2]).T
    assert up_to_a_rigid_motion(moved, expected, plate.nodes_mm) < 1e-9 * np.abs(expected).max()


def timoshenko(one, two, thick, heat):
    """Curvature of a bimetal (Timoshenko 1925, eq. 4), thicknesses of the first and second metal."""
    m, n = thick[0] / thick[1], one.young_MPa / two.young_MPa
    return (6 * (one.expansion_per_K - two.expansion_per_K) * heat * (1 + m) ** 2) / (
        sum(thick) * (3 * (1 + m) ** 2 + (1 + m * n) * (m**2 + 1 / (m * n)))
    )


def bimetal_curvature(al, invar):
    strip = Structure(
        (Box("al", (0, 0, 0), (80, 4, 2)), Box("invar", (0, 0, 2), (80, 4, 3))),
        {"al": al, "invar": invar},
        {"A": Foot((0, 0, 0), "xyz"), "B": Foot((80, 0, 0), "yz"), "C": Foot((0, 4, 0), "z")},
        cell_mm=2,
    )
    elastic = Elasticity(strip)
    moved = elastic.displace(np.full(strip.mesh.nvertices, 10.0))
    x, y, z = elastic.nodes_mm.T
    line = (y == 0) & (z == 0) & (np.abs(x - 40) < 15)
    # Aluminium below grows more: the middle rises above the ends.
    return -2 * np.polyfit(x[line] - 40, moved[line, 2], 2)[0]


def test_a_bimetal_bends_as_timoshenko_says():
    assert timoshenko(AL, INVAR, (2, 1), 10) == pytest.approx(1.0868493e-4, rel=1e-7)
    without = (dataclasses.replace(m, poisson=0.0) for m in (AL, INVAR))
    assert abs(bimetal_curvature(*without)) == pytest.approx(1.0868493e-4, rel=1e-6)
    # A beam's formula knows no Poisson's ratio; real metals bend a little less or more.
    assert abs(bimetal_curvature(AL, INVAR)) == pytest.approx(1.0868493e-4, rel=0.01)


def slab_camera(material=AL):
    """Four slabs on a bench: the smallest body with the optics' faces."""
    faces = {
        "M1": Face((-36, 5), (36, 66), 0.0),
        "M2": Face((-12, -11), (12, 11), 148.6),
        "M3": Face((-28, -58), (28, -11), 0.0),
        "FP": Face((-12, -38), (12, -17), 177.0),
    }
    boxes = (
        Box("bench", (-40, -85, -30), (40, -75, 190)),
        Box("rear", (-40, -75, -30), (40, 70, -20)),
        Box("M1", (-36, 5, -20), (36, 66, 0)),
        Box("M3", (-28, -58, -20), (28, -11, 0)),
        Box("front", (-40, -75, 177), (40, 11, 190)),
        Box("M2", (-12, -11, 148.6), (12, 11, 177)),
        Box("FP", (-12, -38, 177), (12, -17, 190), replaces=("front",)),
    )
    stand = {
        "A": Foot((0, -85, -30), "xyz"),
        "B": Foot((0, -85, 190), "xy"),
        "C": Foot((40, -85, 50), "y"),
    }
    return Structure(boxes, dict.fromkeys([b.part for b in boxes], material), stand, faces)


@pytest.fixture(scope="module")
def slabs():
    body = slab_camera()
    return body, Elasticity(body), OPTICS.pivot_mm


def test_the_adjoint_is_the_forward_map(slabs):
    body, elastic, pivots = slabs
    rise = np.random.default_rng(0).normal(size=body.mesh.nvertices)
    forward = elastic.motion_rows(pivots) @ elastic.displace(rise).ravel()
    adjoint = elastic.motion_map(pivots) @ rise
    np.testing.assert_allclose(adjoint, forward, rtol=0, atol=1e-10 * np.abs(forward).max())


def test_uniform_heat_of_one_metal_only_grows_the_camera(slabs):
    body, elastic, pivots = slabs
    motions = (elastic.motion_map(pivots) @ np.ones(body.mesh.nvertices)).reshape(4, 8)
    alpha = AL.expansion_per_K
    np.testing.assert_allclose(motions[:, 6], alpha, rtol=1e-9)
    np.testing.assert_allclose(motions[:, :3], alpha * (pivots - [0, -85, -30]), rtol=0, atol=1e-12)
    np.testing.assert_allclose(motions[:, 3:6], 0.0, atol=1e-14)
    np.testing.assert_allclose(motions[:3, 7], 0.0, atol=1e-14)
    # The beam does not grow, and does not care.
    seen = los_jacobian(OPTICS) @ motions.ravel()
    assert np.abs(seen[:4]).max() < 5e-5
    assert np.abs(seen[4:]).max() < 2e-3


def test_a_camera_that_grows_with_its_beam_sees_the_same(slabs):
    body, elastic, pivots = slabs
    motions = (elastic.motion_map(pivots) @ np.ones(body.mesh.nvertices)).reshape(4, 8)
    foot, light, size = np.array([0, -85, -30]), OPTICS.laser, 1 + AL.expansion_per_K
    grown = Rays(foot + size * (light.origin_mm - foot), light.direction)
    # The mirrors stand to 1e-12 mm where the solver puts them: a thousand times the rays' rounding.
    px = OPTICS.observe(motions[:, :6], motions[:, 6], motions[:3, 7], rays=grown)[0]
    np.testing.assert_allclose(px, OPTICS.observe()[0], rtol=0, atol=1e-9)


def test_rows_read_the_motion_that_was_put_in(slabs):
    _, elastic, pivots = slabs
    rows, nodes = elastic.motion_rows(pivots), elastic.nodes_mm
    shift, turn, growth = np.array([1e-3, -2e-3, 3e-3]), np.array([1e-5, 2e-5, -3e-5]), 4e-5
    for optic in range(4):
        r = nodes - pivots[optic]
        bend = 5e-7 * (optic < 3)
        moved = shift + np.cross(turn, r) + growth * r
        moved[:, 2] += bend * (r[:, 0] ** 2 + r[:, 1] ** 2) / 2
        read = rows[8 * optic : 8 * optic + 8] @ moved.ravel()
        np.testing.assert_allclose(read, [*shift, *turn, growth, bend], rtol=1e-9, atol=1e-15)


def test_outside_facets_have_the_area_of_the_walls():
    body = brick(10, 20, 100)
    mesh = body.mesh
    span = np.ptp(mesh.p[:, mesh.facets[:, body.facets("bar", "+x")]], axis=1)
    assert np.sum(span[1] * span[2]) == pytest.approx(2000)
    assert body.facets().size == body.outside.size
    with pytest.raises(ValueError, match="side must be one of"):
        body.facets(side="up")


def test_the_volume_about_vertices_is_that_of_the_body():
    volume = brick(10, 20, 100).vertex_volume_mm3
    assert volume.sum() == pytest.approx(20000)
    assert volume.min() == pytest.approx(20000 / 2 / 8)


def test_cells_are_no_longer_than_asked():
    assert max(np.diff(brick(10, 20, 100, cell_mm=7).grid_mm[2])) <= 7 + 1e-9
    assert 33.3 in brick(10, 20, 100, planes_mm={"z": [33.3]}).grid_mm[2]


def test_light_gets_through_or_the_part_is_named():
    body = slab_camera()
    body.check_light(OPTICS)
    shutter = Box("stub", (-20, -75, 150), (20, -20, 160))
    stub = {"boxes": (*body.boxes, shutter), "materials": {**body.materials, "stub": AL}}
    with pytest.raises(ValueError, match="box 8: part 'stub' cuts the beam on its way to FP"):
        dataclasses.replace(body, **stub).check_light(OPTICS)
    window = Box("stub", (-18, -60, 150), (18, -20, 160))
    dataclasses.replace(body, **stub, holes=(window,)).check_light(OPTICS)
    shutter = Box("front", (-40, 11, 177), (40, 60, 190))
    with pytest.raises(ValueError, match="part 'front' cuts the beam on its way to M1"):
        dataclasses.replace(body, boxes=(*body.boxes, shutter)).check_light(OPTICS)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            {"boxes": (Box("bar", (0, 0, 0), (10, 10, 50)), Box("lid", (0, 0, 40), (10, 10, 60)))},
            r"box 2: part 'lid' overlaps part 'bar'; if that is meant, give it the key replaces",
        ),
        (
            {"boxes": (Box("bar", (0, 0, 0), (10, 10, 50)), Box("lid", (0, 0, 60), (10, 10, 70)))},
            "part 'lid' floats free: its boxes share no face with the body; check low_mm",
        ),
        ({"boxes": (Box("bar", (0, 0, 0), (10, 10, 50)), Box("new", (0, 0, 50), (10, 10, 60)))},
            "part 'new' has no key in materials"),
        ({"feet": {"A": Foot((0, 0, 0), "xyz"), "B": Foot((0, 0, 50), "xy")}},
            "the keys held of A, B leave the body free to turn about z"),
        ({"feet": {}}, "the keys held of no foot leave the body free to"),
        ({"feet": feet(10, 50) | {"D": Foot((99, 0, 0), "x")}},
            r"feet: D: there is no material at \[99.0, 0.0, 0.0\] mm"),
        ({"materials": {"bar": AL, "lid": AL, "rib": AL}}, "materials: there is no box of part 'rib'"),
        ({"holes": (Box("cap", (0, 0, 0), (1, 1, 1)),)}, "holes: there is no box of part 'cap'"),
        ({"faces": {"M4": Face((0, 0), (1, 1), 0)}}, "faces must be one of 'M1', 'M2', 'M3', 'FP'"),
        ({"planes_mm": {"w": [1.0]}}, "planes_mm must be one of 'x', 'y', 'z'"),
        ({"cell_mm": 0.0}, "cell_mm must be positive"),
    ],
)  # fmt: skip
def test_a_body_that_cannot_be_is_refused_by_part_and_key(change, said):
    body = Structure(
        (Box("bar", (0, 0, 0), (10, 10, 50)), Box("lid", (0, 0, 50), (10, 10, 60))),
        {"bar": AL, "lid": AL},
        feet(10, 50),
    )
    with pytest.raises(ValueError, match=said) as refusal:
        dataclasses.replace(body, **change)
    assert "\n" not in str(refusal.value)


def test_a_part_may_replace_another_where_it_says_so():
    boxes = (
        Box("bar", (0, 0, 0), (10, 10, 50)),
        Box("lid", (0, 0, 40), (10, 10, 60), replaces=("bar",)),
    )
    body = Structure(boxes, {"bar": AL, "lid": INVAR}, feet(10, 40))
    assert sorted(set(body.per_cell("young_MPa"))) == [AL.young_MPa, INVAR.young_MPa]


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Box("bar", (0, 0, 0), (0, 1, 1)), "high_mm of part 'bar' must lie above low_mm"),
        (lambda: Box("bar", (0, 0), (1, 1)), r"low_mm must have shape \(3,\)"),
        (lambda: Foot((0, 0, 0), "w"), "held must be letters of 'xyz', got 'w'"),
        (lambda: dataclasses.replace(AL, young_MPa=-1), "young_MPa must be positive"),
        (lambda: dataclasses.replace(AL, poisson=0.5), "poisson must be a finite number from"),
        (lambda: Material(1, 0.3, 2.0, 1, 1, 1), "expansion_per_K must be a finite number from"),
        (
            lambda: Elasticity(brick(1, 1, 1)).motion_rows(np.zeros((4, 3))),
            "faces: key M1 is missing",
        ),
    ],
)
def test_a_part_that_cannot_be_is_refused(make, said):
    with pytest.raises(ValueError, match=said):
        make()
