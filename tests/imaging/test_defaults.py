"""What a call does where nothing is said: the defaults that the reference shows, and a table of all that
was measured."""

import numpy as np
import pytest

import losbench as lb


@pytest.mark.parametrize(
    ("thing", "known"),
    [
        (lb.EIWA, {"max_iter": 50, "stop": "error", "hot_pixel_gate": False}),
        (lb.Weighted, {"tolerance": 1e-3, "max_iter": 50, "hot_pixel_gate": False}),
        (lb.Likelihood, {"tolerance": 2.5e-4, "max_iter": 50}),
        (lb.Gaussian, {"tolerance": 1e-8, "max_iter": 50}),
        (lb.Empirical, {"shape": None, "tolerance": 2.5e-4, "max_iter": 50}),
        (lb.AutoCentroid, {"hot_pixel_gate": False}),
        (lb.Find, {"threshold": 8.0, "smooth": 0.0, "most": 50_000, "order": "light"}),
        (
            lb.Detector,
            {
                "gain_e_per_dn": 1.0,
                "read_noise_e": 0.0,
                "offset_dn": 0.0,
                "full_well_e": np.inf,
                "bits": 16,
                "prnu": 0.0,
                "prnu_seed": 0,
                "hot_pixels": (),
            },
        ),
        (
            lb.aided_centroid,
            {
                "method": "iterative",
                "epoch": "end",
                "background": "border",
                "region": "data",
                "rate_prior_rad_s": 0.0,
                "tolerance": 1e-5,
                "max_iter": 50,
            },
        ),
        (lb.streak_bound, {"background": 0.0}),
        (lb.estimate_gain, {"full_scale_dn": np.inf}),
    ],
    ids=lambda each: getattr(each, "__name__", ""),
)
def test_defaults_of_the_public_face_are_changed_on_purpose(thing, known, defaults_of):
    found = defaults_of(thing)
    assert {name: found[name] for name in known} == known


def test_all_that_was_measured_stands_under_its_name():
    rng = np.random.default_rng(1)
    numbers = {name: rng.random((2, 3)) for name in ("flux", "background")}
    found = lb.Centroids(
        xy=rng.random((2, 3, 2)),
        sigma_xy=rng.random((2, 3, 2)),
        n_iter=rng.integers(1, 9, (2, 3)),
        flags=np.array([[0, int(lb.SpotFlag.RING), 0], [0, 0, int(lb.SpotFlag.EDGE)]]),
        window=13,
        **numbers,
    )
    table = found.to_frame()
    assert table["frame"].tolist() == [0, 0, 0, 1, 1, 1]
    assert table["spot"].tolist() == [0, 1, 2, 0, 1, 2]
    for k, axis in enumerate("xy"):
        np.testing.assert_array_equal(table[axis], found.xy[..., k].ravel())
        np.testing.assert_array_equal(table[f"sigma_{axis}"], found.sigma_xy[..., k].ravel())
    for name in ("flux", "background", "n_iter"):
        np.testing.assert_array_equal(table[name], getattr(found, name).ravel())
    assert table["flags"].tolist() == ["", "RING", "", "", "", "EDGE"]
