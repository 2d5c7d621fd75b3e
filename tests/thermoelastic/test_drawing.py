"""What the picture shows: all walls that face the eye, none behind the cut, rays that end on optics."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from losbench.thermoelastic.drawing import draw_camera
from losbench.thermoelastic.model import example_camera


@pytest.fixture(scope="module")
def camera():
    return example_camera()


@pytest.fixture
def ax():
    figure, axes = plt.subplots()
    yield axes
    plt.close(figure)


def area(collection):
    total = 0.0
    for path in collection.get_paths():
        x, y = path.vertices[:-1].T
        total += 0.5 * abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))
    return total


def test_from_the_side_a_wall_is_as_large_as_it_is(camera, ax):
    """From +x the walls that face the eye are those that face +x."""
    drawn = draw_camera(
        ax, camera, np.zeros(camera.structure.mesh.nvertices), azimuth_deg=90, elevation_deg=0
    )
    mesh = camera.structure.mesh
    corners = mesh.p[:, mesh.facets[:, camera.structure.facets(side="+x")]]
    assert area(drawn) == pytest.approx(np.prod(np.ptp(corners[1:], axis=1), axis=0).sum())


def test_a_cut_takes_the_near_half_away_and_rays_are_added(camera, ax):
    rise = camera.structure.mesh.p[1]
    whole = draw_camera(ax, camera, rise)
    cut = draw_camera(ax, camera, rise, cut_mm=0.0)
    lit = draw_camera(ax, camera, rise, cut_mm=0.0, rays=True)
    assert whole.get_clim() == (rise.min(), rise.max())
    assert len(cut.get_paths()) < len(whole.get_paths())
    assert len(lit.get_paths()) - len(cut.get_paths()) == 3 * 3 * 4 * 40
    assert {text.get_text() for text in ax.texts} == {"M1", "M2, the stop", "M3", "detector"}


def test_deformation_is_drawn_as_often_as_said(camera, ax):
    moved = np.zeros((camera.elasticity.basis.N, 3))
    moved[:, 1] = 0.01
    values = np.zeros(camera.structure.mesh.nvertices)
    options = {"azimuth_deg": 90, "elevation_deg": 0}
    rest = draw_camera(ax, camera, values, **options).get_paths()
    shifted = draw_camera(
        ax, camera, values, displacement_mm=moved, exaggerate=300, **options
    ).get_paths()
    step = shifted[0].vertices - rest[0].vertices
    np.testing.assert_allclose(step, np.broadcast_to([0.0, 3.0], step.shape), atol=1e-9)


def test_values_must_fit_the_mesh(camera, ax):
    with pytest.raises(ValueError, match=r"values must have shape \(882,\)"):
        draw_camera(ax, camera, [1.0, 2.0])
