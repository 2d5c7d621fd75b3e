"""The photon transfer curve, the ends of the scale and the fixed pattern."""

import numpy as np
import pytest

import losbench as lb

SIZE = (300, 400)


@pytest.mark.parametrize("level_e", [0.5, 40.0, 3000.0])
def test_mean_and_variance_follow_the_photon_transfer_curve(level_e):
    detector = lb.Detector(gain_e_per_dn=1.7, read_noise_e=6.0, offset_dn=50.0)
    frame = detector.expose(np.full(SIZE, level_e), 7).astype(float)
    mean = 50 + level_e / 1.7
    variance = (level_e + 36.0) / 1.7**2 + 1 / 12
    assert frame.mean() == pytest.approx(mean, abs=4 * np.sqrt(variance / frame.size))
    assert frame.var() == pytest.approx(variance, rel=4 * np.sqrt(2 / frame.size) + 0.005)
    assert detector.variance_dn(mean) == pytest.approx(variance)


def test_without_light_and_noise_the_reading_is_the_offset():
    np.testing.assert_array_equal(lb.Detector(offset_dn=64).expose(np.zeros((2, 3)), 0), 64)


@pytest.mark.parametrize(
    ("detector", "top"),
    [
        (lb.Detector(bits=8), 255),
        (lb.Detector(bits=12, full_well_e=1e6), 4095),
        (lb.Detector(gain_e_per_dn=2.0, full_well_e=1000.0, offset_dn=10.0), 510),
    ],
)
def test_saturation_is_the_full_well_or_the_converter(detector, top):
    assert detector.full_scale_dn == top
    np.testing.assert_array_equal(detector.expose(np.full((5, 5), 1e5), 0), top)


def test_the_fixed_pattern_belongs_to_the_sensor_not_to_the_window():
    detector = lb.Detector(gain_e_per_dn=1e3, prnu=0.05, prnu_seed=3)
    light = np.full((40, 50), 4e7)
    frame = detector.expose(light, 1).astype(float)
    window = detector.expose(light[:10, :12], 2, origin=(7, 5)).astype(float)
    batch = detector.expose(np.full((2, 10, 12), 4e7), 3, origin=[(7, 5), (0, 0)]).astype(float)
    assert frame.std() / frame.mean() == pytest.approx(0.05, rel=0.06)
    np.testing.assert_allclose(window, frame[5:15, 7:19], rtol=2e-3)
    np.testing.assert_allclose(batch, [frame[5:15, 7:19], frame[:10, :12]], rtol=2e-3)
    other = lb.Detector(gain_e_per_dn=1e3, prnu=0.05, prnu_seed=4).expose(light, 1).astype(float)
    assert abs(np.corrcoef(frame.ravel(), other.ravel())[0, 1]) < 0.1


def test_hot_pixels_sit_at_their_place_in_every_window():
    detector = lb.Detector(hot_pixels=((6, 4, 5000.0), (100, 100, 1.0)))
    frame = detector.expose(np.zeros((8, 9)), 0)
    assert np.argwhere(frame).tolist() == [[4, 6]]
    assert np.argwhere(
        detector.expose(np.zeros((2, 3, 3)), 0, origin=[(5, 3), (0, 0)])
    ).tolist() == [[0, 1, 1]]


def test_the_same_seed_gives_the_same_frame():
    detector = lb.Detector(read_noise_e=5.0, offset_dn=100)
    light = np.full((6, 7), 200.0)
    np.testing.assert_array_equal(
        detector.expose(light, 5), detector.expose(light, np.random.default_rng(5))
    )
    assert (detector.expose(light, 5) != detector.expose(light, 6)).any()


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"gain_e_per_dn": 0.0}, "gain_e_per_dn must be positive, got 0"),
        ({"read_noise_e": -1.0}, "read_noise_e must be a finite number of at least 0, got -1"),
        ({"offset_dn": np.nan}, "offset_dn must be a finite number of at least 0, got nan"),
        ({"full_well_e": 0.0}, "full_well_e must be positive, got 0"),
        ({"bits": 7}, "bits must be a whole number from 8 to 16, got 7"),
        ({"prnu": 0.6}, "prnu must be a finite number from 0 to 0.5, got 0.6"),
        ({"prnu_seed": -1}, "prnu_seed must be a whole number from 0"),
        ({"full_well_e": "x"}, "full_well_e must be a number, got 'x'"),
        ({"full_well_e": np.nan}, "full_well_e must be a finite number, got nan"),
        ({"hot_pixels": (1, 2, 3.0)}, r"hot_pixels must be \(x, y, electrons\) .*, got 1"),
        ({"hot_pixels": 5}, r"hot_pixels must be a tuple of \(x, y, electrons\), got 5"),
        (
            {"hot_pixels": ((1, 2, "x"),)},
            r"hot_pixels must be \(x, y, electrons\) .*, got \(1, 2, 'x'\)",
        ),
        ({"hot_pixels": ((1, 2),)}, r"hot_pixels must be \(x, y, electrons\) .*, got \(1, 2\)"),
    ],
)
def test_impossible_parameters_are_refused_by_name(parameters, message):
    with pytest.raises(ValueError, match=message):
        lb.Detector(**parameters)


@pytest.mark.parametrize(
    ("electrons", "message"),
    [
        (np.full((2, 2), -1.0), "electrons must not be negative, got -1"),
        (np.array([[np.nan, 1.0]]), "electrons must be finite, got 1 NaN or infinite of 2 values"),
        (np.array([[np.inf, 1.0]]), "electrons must be finite, got 1 NaN or infinite of 2 values"),
        (np.ones(3), r"electrons must have shape \(\.\.\., rows, columns\), got \(3,\)"),
    ],
)
def test_light_that_cannot_be_is_refused(electrons, message):
    with pytest.raises(ValueError, match=message):
        lb.Detector().expose(electrons, 0)


def test_a_detector_survives_its_file_beside_the_camera(tmp_path):
    camera = lb.Camera(260.0, 10.0, (1080, 1920))
    detector = lb.Detector(
        gain_e_per_dn=4.0, read_noise_e=5.0, bits=12, hot_pixels=((3, 4, 500.0),)
    )
    path = tmp_path / "camera.toml"
    path.write_text(camera.to_toml() + detector.to_toml())
    read = lb.Detector.from_toml(path)
    assert lb.Camera.from_toml(path) == camera
    frame = np.full((8, 8), 100.0)
    np.testing.assert_array_equal(read.expose(frame, 1), detector.expose(frame, 1))
    path.write_text(camera.to_toml())
    assert lb.Detector.from_toml(path) is None
    path.write_text("[detector]\ngain = 4.0\n")
    with pytest.raises(
        ValueError, match=r"camera.toml \[detector\]: unknown key gain; known are gain_e_per_dn"
    ):
        lb.Detector.from_toml(path)


@pytest.mark.parametrize("rng", [None, "seed", -1, 1.5])
def test_randomness_must_be_named(rng):
    with pytest.raises(
        ValueError, match="seed must be a numpy Generator or a seed of at least 0, got"
    ):
        lb.Detector().expose(np.ones((3, 3)), rng)


def test_more_electrons_than_can_be_counted_are_refused():
    with pytest.raises(ValueError, match=r"electrons must be at most 1e\+18 a pixel, got 1e\+30"):
        lb.Detector().expose(np.full((3, 3), 1e30), 1)


@pytest.mark.parametrize("full_well_e", [2000.0, 2001.0, 2001.9])
def test_no_reading_exceeds_the_last_whole_number_of_the_full_scale(full_well_e):
    detector = lb.Detector(gain_e_per_dn=2.0, read_noise_e=30.0, full_well_e=full_well_e)
    frame = detector.expose(np.full((40, 40), 5000.0), 1)
    assert frame.max() == int(full_well_e // 2)
