"""The centroid that a call's spots ask for: by shape, by saturation, and why."""

import numpy as np
import pytest
from noisy_spots import CAMERA, rms, spots

import losbench as lb

SIDE = 47
FINE = (np.arange(5 * SIDE) + 0.5) / 5 - 0.5 - SIDE // 2


def shaped(profile, count=12, seed=0):
    """Frames (F, 47, 47) of a profile of the distance, in pixels, and where its middle is."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(-0.5, 0.5, (count, 1, 2))
    distance = np.hypot(FINE - xy[..., :1], FINE[:, None] - xy[..., 1:])
    light = 1000.0 * profile(distance).reshape(count, SIDE, 5, SIDE, 5).mean(axis=(2, 4))
    return (light + rng.normal(100.0, 3.0, light.shape)).astype(np.float32), xy + SIDE // 2


@pytest.mark.parametrize(
    ("profile", "kind"),
    [
        (lambda r: np.exp(-0.5 * (r / 2.0) ** 2), lb.Weighted),
        (lambda r: (1 + (r / 4.0) ** 2) ** -2.5, lb.Weighted),
        (lambda r: 1.0 * (r < 5.0), lb.EIWA),
        (lambda r: np.exp(-0.5 * ((r - 5.0) / 0.8) ** 2), lb.EIWA),
    ],
    ids=["gaussian", "moffat", "disc", "ring"],
)
def test_the_shape_decides(profile, kind):
    image, xy = shaped(profile)
    found = lb.centroid(image, np.rint(xy), method=lb.AutoCentroid(window=21))
    assert type(found.method) is kind
    assert found.reason.startswith(kind.__name__.lower() + ": a Gaussian leaves")
    again = lb.centroid(image, np.rint(xy), method=found.method)
    np.testing.assert_allclose(again.xy, found.xy, atol=1e-9)
    assert rms(found.xy - xy) < 0.02


def test_saturated_spots_have_their_cores_masked():
    rng = np.random.default_rng(1)
    xy = 20 + rng.uniform(-0.5, 0.5, (40, 1, 2))
    detector = lb.Detector(gain_e_per_dn=4.0, read_noise_e=12.0, offset_dn=50.0, bits=12)
    image = detector.expose(lb.render_spots(xy, 8e5, 2.0, (41, 41)) + 100.0, rng)
    found = lb.centroid(image, np.rint(xy), method="auto", detector=detector)
    assert isinstance(found.method, lb.Likelihood)
    assert "100 % of the spots are saturated" in found.reason
    assert rms((found.xy - xy) / found.sigma_xy) == pytest.approx(1.0, abs=0.3)


def test_round_spots_are_measured_as_well_as_can_be_whatever_the_frames_show_else():
    image, xy, _ = spots(2.0, 30, n=300)
    auto = lb.centroid(image, np.rint(xy), method=lb.AutoCentroid(window=13), detector=CAMERA)
    told = lb.centroid(image, np.rint(xy), method=lb.Weighted(2.0, window=13), detector=CAMERA)
    assert rms(auto.xy - told.xy) < 0.05 * rms(told.xy - xy)
    nothing = lb.centroid(np.full((2, 30, 30), 7.0), [[15, 15]], method=lb.AutoCentroid(window=9))
    assert nothing.reason == "weighted: no spot stands out enough to tell its shape"
    assert np.isnan(lb.centroid(image[:1], [[np.nan, 3.0]], method="auto").xy).all()


def test_other_methods_need_no_reason():
    image, xy, _ = spots(2.0, 30, n=3)
    found = lb.centroid(image, np.rint(xy), method=lb.EIWA(13))
    assert found.method == lb.EIWA(13) and found.reason == ""
