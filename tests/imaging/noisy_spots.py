"""Noisy spots of known place, and the least error that their centroids can have."""

import numpy as np

import losbench as lb

CAMERA = lb.Detector(gain_e_per_dn=1.0, read_noise_e=5.0, offset_dn=50.0)
BACKGROUND_E = 100.0
OVER_BACKGROUND = BACKGROUND_E + 25.0


def first_odd(length):
    return int(np.ceil(length)) | 1


def spots(sigma, snr, n=2000, seed=0):
    """Frames of one spot each with that peak signal to noise, where it is, and its flux."""
    peak = (snr**2 + np.sqrt(snr**4 + 4 * snr**2 * OVER_BACKGROUND)) / 2
    flux = peak * 2 * np.pi * (sigma**2 + 1 / 12)
    size = first_odd(6 * sigma + 17)
    rng = np.random.default_rng(seed)
    xy = size // 2 + rng.uniform(-0.5, 0.5, (n, 1, 2))
    return (
        CAMERA.expose(lb.render_spots(xy, flux, sigma, (size, size)) + BACKGROUND_E, rng),
        xy,
        flux,
    )


def cramer_rao(sigma, flux):
    """Smallest possible standard error of x, from the Fisher information of a pixel-integrated
    Gaussian.
    """
    side, h = 81, 1e-4
    left, at, right = (
        lb.render_spots([[40 + d, 40]], flux, sigma, (side, side)) for d in (-h, 0, h)
    )
    return float(((((right - left) / (2 * h)) ** 2 / (at + OVER_BACKGROUND)).sum()) ** -0.5)


def rms(error):
    return float(np.sqrt(np.mean(error**2)))
