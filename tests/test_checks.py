"""What is taken as numbers, what as missing, and what is refused by name."""

from decimal import Decimal
from fractions import Fraction

import numpy as np
import pandas as pd
import pytest

import losbench as lb
from losbench.checks import finite, finite_or_nan, integer, number, unmasked

MASKED = np.ma.array([1.0, 2.0, 3.0, 4.0, 100.0], mask=[0, 0, 0, 0, 1])


@pytest.mark.parametrize(
    "value",
    [
        MASKED,
        np.ma.array([1, 2, 3, 4, 100], mask=[0, 0, 0, 0, 1]),
        np.ma.array(np.array([1, 2, 3, 4, 100], np.uint8), mask=[0, 0, 0, 0, 1]),
        [1, 2.0, Fraction(3), Decimal(4), None],
        pd.array([1, 2, 3, 4, None], dtype="Int64"),
        pd.Series([1, 2, 3, 4, None], dtype="Float64"),
    ],
    ids=["floats", "integers", "bytes", "mixed", "pandas", "series"],
)
def test_what_is_missing_is_nan_where_that_is_allowed_and_refused_elsewhere(value):
    np.testing.assert_array_equal(finite_or_nan("x", value), [1, 2, 3, 4, np.nan])
    with pytest.raises(ValueError, match="x must be finite, got 1 NaN or infinite of 5 values"):
        finite("x", value)


def test_an_unmasked_array_stays_what_it_is():
    given = np.ma.array(np.arange(3, dtype=np.uint16))
    assert unmasked(given).dtype == np.uint16
    assert unmasked(np.ma.array(given, mask=[1, 0, 0])).dtype == np.float32


@pytest.mark.parametrize(
    ("value", "held"),
    [
        (np.array(["2026-03-01"], "datetime64[D]"), "dates"),
        (np.array([5], "timedelta64[s]"), "durations"),
        ([np.timedelta64(5, "s"), 1.0], "timedelta64"),
        ([pd.Timestamp("2026-03-01")], "Timestamp"),
        (["1.5", "2"], "text"),
        (np.array(["1.5", 2], dtype=object), "str"),
        ([b"1"], "text"),
        ([1 + 2j], "complex"),
        (np.array([1j, 2], dtype=object), "complex"),
        ([10**400, 1], "an integer too large"),
        (np.zeros(2, dtype=[("a", float)]), "records"),
        ([[1.0, 2.0], [3.0]], ""),
    ],
)
def test_what_is_no_number_is_refused_by_name(value, held):
    for check in (finite, finite_or_nan):
        with pytest.raises(ValueError, match=f"x must be an array of numbers, got .*{held}"):
            check("x", value)


def test_numbers_with_a_unit_are_not_taken_without_it():
    units = pytest.importorskip("astropy.units")
    with pytest.raises(ValueError, match="x must be plain numbers, got some in arcsec"):
        finite("x", [1.0, 2.0] * units.arcsec)


@pytest.mark.parametrize(
    "value", [10**400, "1", None, 1j, np.ma.masked, np.timedelta64(1, "s"), np.datetime64(1, "s")]
)
def test_one_number_is_a_number(value):
    with pytest.raises(ValueError, match="x must be a number, got ") as refusal:
        number("x", value)
    assert len(str(refusal.value)) < 120


@pytest.mark.parametrize(
    "value",
    [10**400, 10**5000, 2**63, "1", np.timedelta64(1, "s"), 1.5],
    ids=lambda v: type(v).__name__,
)
def test_one_whole_number_is_one(value):
    with pytest.raises(ValueError, match="x must be a whole number") as refusal:
        integer("x", value)
    assert len(str(refusal.value)) < 140
    assert integer("x", 2**63 - 1) == 2**63 - 1


def test_masks_reach_the_statistics():
    assert float(lb.rms(MASKED)) == pytest.approx(np.sqrt(1.25))
    assert float(lb.pv(MASKED)) == 3
    plain = np.array([1.0, 2.0, 3.0, 4.0, np.nan])
    assert lb.nea(MASKED) == lb.nea(plain)
    with pytest.raises(ValueError, match="y must be finite"):
        lb.lstsq(np.ones((5, 1)), MASKED)
    celsius = np.ma.array(np.linspace(20, 25, 50))
    celsius.data[10] = -999
    celsius[10] = np.ma.masked
    angles = np.stack([1e-6 * (np.linspace(20, 25, 50) - 20)] * 3, axis=1)
    found = lb.fit_sensitivity(celsius, angles).k_arcsec_per_degC
    np.testing.assert_allclose(found, 0.2062648, rtol=1e-6)


def test_masks_reach_the_finder_and_colours_are_refused():
    rng = np.random.default_rng(0)
    image = 100 + lb.render_spots([[30.3, 22.7]], 25e3, 2.0, (64, 64)) + rng.normal(0, 3, (64, 64))
    image[50:52, 50:53] = 60000
    found = lb.find_spots(np.ma.array(image, mask=image > 40000))
    np.testing.assert_allclose(found, [[30.3, 22.7]], atol=0.5)
    with pytest.raises(ValueError, match="colour image: take one channel"):
        lb.centroid(np.stack([image] * 3, axis=-1), found)
    with pytest.raises(ValueError, match=r"frames must have shape \(F, H, W\) or \(H, W\)"):
        lb.centroid(np.stack([image] * 3, axis=-1)[None], found)


def test_allan_deviation_keeps_its_digits_far_from_zero():
    noise = np.random.default_rng(1).standard_normal(4000)
    near = lb.allan_deviation(noise, rate_hz=1.0, tau_s=[1, 10, 100])
    far = lb.allan_deviation(noise + 1e9, rate_hz=1.0, tau_s=[1, 10, 100])
    np.testing.assert_allclose(far, near, rtol=1e-5)  # 1e9 itself holds noise to 1e-7
