"""The gain that templates leave, step by step, against least squares; and when it is believed."""

from dataclasses import replace

import numpy as np
import pytest

from losbench.imaging import residuals
from losbench.imaging.columns import Templates
from losbench.imaging.noise import PixelNoise
from losbench.imaging.protocols import Windows
from losbench.imaging.residuals import _Left, template_gain
from losbench.imaging.template import TemplateFit

SIDE = 9
STACK = np.full((1, 40, 60), 7, np.uint16)


def windows_of(count=3, floor=4.0, per_dn=0.5, seed=2):
    rng = np.random.default_rng(seed)
    zeros = np.zeros((count, 2))
    noise = PixelNoise(floor * np.arange(1.0, count + 1.0), per_dn, np.zeros((count, 3)))
    signal = rng.normal(20.0, 6.0, (count, SIDE + 2, SIDE + 2))
    return Windows(signal, SIDE, zeros, zeros.astype(int), noise, zeros + 1.5)


def fit_of(count=3, flux=900.0):
    centre = np.array([[0.2, -0.3], [0.0, 0.0], [-0.4, 0.1]])[:count]
    width = np.array([[1.5, 1.5], [1.2, 1.8], [0.6, 0.5]])[:count]
    flux = flux * np.array([1.0, 2.0, -1.0])[:count]
    told = np.ones(count, bool)
    return TemplateFit(centre, width, flux, np.ones((count, 3)), np.ones(count, int), told)


@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize("per_dn", [0.0, 0.5])
def test_what_is_left_is_that_of_weighted_least_squares(first, per_dn):
    """Of the template, its slopes by place and width, and a plane; corrected for leverage."""
    windows, fit = windows_of(per_dn=per_dn), fit_of()
    windows.signal[0, 2, 2] += 300.0
    found = _Left.of(windows, fit, first=first)
    profiles = Templates.of(SIDE, fit.centre, fit.width, np.float64, free=True).profiles
    y, x = np.mgrid[:SIDE, :SIDE] - SIDE // 2
    far = []
    for m in range(3):
        along_x, along_y = profiles[m]
        shapes = [
            np.outer(along_y[i], along_x[j]) for i, j in ((0, 0), (0, 1), (1, 0), (0, 2), (2, 0))
        ]
        basis = np.stack([*shapes, np.ones((SIDE, SIDE)), x, y], axis=-1).reshape(-1, 8)
        light = np.maximum(fit.flux[m] * basis[:, 0], 0.0)
        variance = windows.noise.floor[m] + per_dn * light
        columns = basis / np.sqrt(variance)[:, None]
        columns = columns / np.linalg.norm(columns, axis=0)
        data = windows.signal[m, 1:-1, 1:-1].ravel() / np.sqrt(variance)
        hat = columns @ np.linalg.pinv(columns)
        leverage = np.diag(hat)
        square = (data - hat @ data) ** 2 / (1.0 - leverage)
        use = (leverage < 0.7) & (first | (square < 16.0))
        far.append((~use).sum())
        np.testing.assert_allclose(found.light[m], light)
        np.testing.assert_allclose(
            found.excess[m][use], (square * variance)[use] - windows.noise.floor[m]
        )
        weight = np.where(use, (1.0 - leverage) / (2.0 * variance**2), 0.0)
        np.testing.assert_allclose(found.weight[m], weight, atol=1e-12 * weight.max())
    assert (far[0] > 0) == (not first) and far[2] > 0


@pytest.mark.parametrize(("errors", "told"), [(3.9, True), (4.1, False)])
def test_a_pixel_four_noises_off_is_no_noise(errors, told):
    windows, fit = windows_of(1, per_dn=0.0), fit_of(1)
    windows.signal[:] = 0.0
    windows.signal[0, 2, 8] = 1.0
    pixel = (SIDE + 7,)
    square = _Left.of(windows, fit, first=True).excess[0][pixel] + 4.0
    windows.signal[0, 2, 8] = errors * np.sqrt(4.0 / square)
    assert (_Left.of(windows, fit, first=False).weight[0][pixel] > 0) == told


def test_pixels_without_any_noise_are_borne():
    left = _Left.of(windows_of(floor=0.0, per_dn=0.0), fit_of(), first=True)
    assert all(np.isfinite(part).all() for part in (left.light, left.excess, left.weight))
    assert 1e59 < left.weight.max() <= 0.5 * 1e60  # as if there were a variance of 1e-30


# Rounds


@pytest.fixture
def told(monkeypatch):
    """A gain that every round finds: moment over normal, and what the templates leave."""

    def tell(moments, normal, share=0.0, bright=True):
        asked, rounds = [], []
        windows, fit = windows_of(2), fit_of(2)

        class Fits:
            pass

        fits = Fits()
        fits.windows, fits.fit, fits.bright = windows, fit, np.array([bright, False])
        monkeypatch.setattr(residuals, "spot_fits", lambda *_: fits)

        def fit_template(part, **options):
            asked.append((part, options))
            return replace(fit_of(1), flux=np.array([500.0 + len(asked)]))

        def of(part, fitted, *, first):
            rounds.append((part.noise.per_dn, fitted.flux[0], first))
            # weight * light^2 adds up to the normal, weight * light * excess to the moment
            light = np.array([[2.0, 0.0]])
            weight = np.array([[normal / 4.0, 9.0]])
            return _Left(light, np.array([[moments[len(rounds) - 1] * 2.0 / normal, 5.0]]), weight)

        monkeypatch.setattr(residuals, "fit_template", fit_template)
        monkeypatch.setattr(residuals._Left, "of", of)
        monkeypatch.setattr(residuals, "unexplained", lambda part, fit: np.full(1, share))
        return template_gain([None], STACK), asked, rounds

    return tell


def test_a_gain_is_found_in_three_rounds_each_with_that_of_the_one_before(told):
    found, asked, rounds = told([30.0, 50.0, 40.0], 100.0)
    assert (found.per_dn, found.std_error, found.step_dn) == (pytest.approx(0.4), 0.1, 1.0)
    assert rounds == [
        (0.0, 501.0, True),
        (pytest.approx(0.3), 502.0, False),
        (pytest.approx(0.5), 503.0, False),
    ]
    for part, options in asked:
        assert options == {"free": True, "tolerance": 1e-5, "max_iter": 12}
        assert len(part.signal) == 1
    assert asked[1][0].start.tolist() == asked[0][0].start.tolist() == fit_of(1).centre.tolist()
    assert asked[1][0].width.tolist() == fit_of(1).width.tolist()


@pytest.mark.parametrize(("errors", "believed"), [(2.9, False), (3.1, True), (-9.0, False)])
def test_a_gain_is_believed_from_three_of_its_errors_on(told, errors, believed):
    found, *_ = told([10.0 * errors] * 3, 100.0)
    assert found.known == believed and found.step_dn == 1.0
    assert found.per_dn == (pytest.approx(errors * 0.1) if believed else 0.0)


@pytest.mark.parametrize(("share", "believed"), [(0.019, True), (0.021, False)])
def test_a_gain_is_believed_where_templates_leave_less_than_two_hundredths(told, share, believed):
    assert told([40.0] * 3, 100.0, share)[0].known == believed


def test_without_a_bright_spot_or_any_light_there_is_no_gain(told):
    for found, *_ in (told([40.0] * 3, 100.0, bright=False), told([0.0] * 3, 1e-290)):
        assert (found.per_dn, found.std_error) == (0.0, np.inf)
    assert template_gain([], STACK).std_error == np.inf
