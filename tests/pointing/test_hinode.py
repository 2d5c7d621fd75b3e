"""Eight years of real drift with gross outliers: models judged by years that they have not seen."""

import numpy as np
import pandas as pd
import pytest

import losbench as lb
from losbench.units import arcsec_to_rad, rad_to_arcsec

Fourier, Lagged, Linear = lb.terms.Fourier, lb.terms.Lagged, lb.terms.Linear
Offset, Product, Trend = lb.terms.Offset, lb.terms.Product, lb.terms.Trend
YEAR_S, DAY_S = 31_557_600.0, 86_400.0
TEMPERATURES = ("T_SPCCD", "T_SPCEB")
PLAIN = Offset() + Linear(*TEMPERATURES) + Fourier(YEAR_S) + Trend(1)
CANDIDATES = {
    "trend": Trend(1),
    "trend^2": Product(Trend(1), Trend(1)),
    "temperatures": Linear(*TEMPERATURES),
    **{f"{k} d late": Lagged(*TEMPERATURES, tau_s=k * DAY_S) for k in (2, 10, 30)},
    **{f"year, harmonic {k}": Fourier(YEAR_S, (k,)) for k in (1, 2, 3, 4)},
    "day": Fourier(DAY_S),
    "position": Linear("XCENO", "YCENO"),
    "position^2": Product(Linear("XCENO"), Linear("XCENO"))
    + Product(Linear("YCENO"), Linear("YCENO")),
    "year x trend": Product(Trend(1), Fourier(YEAR_S)),
    "T x trend": Product(Trend(1), Linear(*TEMPERATURES)),
}


@pytest.fixture(scope="module")
def hinode(real_data):
    table = pd.read_csv(real_data("hinode-sotsp") / "pointing_2006_2014.csv")
    moment = pd.to_datetime(table["datestr"], format="%Y%m%d_%H%M%S")
    sensors = {name: table[name].to_numpy() for name in (*TEMPERATURES, "XCENO", "YCENO")}
    return {
        "angles": arcsec_to_rad(table[["DXCEN", "DYCEN"]].to_numpy()),
        "sensors": sensors,
        "time_s": (moment - moment[0]).dt.total_seconds().to_numpy(),
        "folds": moment.dt.year.to_numpy(),
    }


def test_the_plain_model_predicts_years_left_out(hinode):
    found = lb.cross_validate(PLAIN, **hinode)
    assert (rad_to_arcsec(found.sigma) <= [3.4, 7.5]).all(), rad_to_arcsec(found.sigma)
    least = lb.cross_validate(PLAIN, **hinode, solver=lb.LeastSquares())
    assert (least.sigma > found.sigma).all()
    # The observation before needs no model, and is better on both axes.
    assert (found.baselines["last"] < found.sigma).all()
    assert (found.sigma < found.baselines["30 d"]).all()


@pytest.mark.slow
@pytest.mark.parametrize(("axis", "limit_arcsec"), [(0, 2.3), (1, 4.2)])
def test_terms_chosen_without_a_year_predict_it(hinode, axis, limit_arcsec):
    one = hinode | {"angles": hinode["angles"][:, axis]}
    found = lb.choose(CANDIDATES, **one)
    nested = float(rad_to_arcsec(found.nested_sigma))
    assert nested <= limit_arcsec
    assert found.picked["position"] == found.folds == 9
    seen = float(rad_to_arcsec(found.path[-1][1]))
    assert nested > 0.99 * seen  # what a choice has seen flatters it


@pytest.mark.slow
def test_gross_outliers_are_named_and_cost_least_squares_its_width(hinode):
    series = {name: hinode[name] for name in ("angles", "sensors", "time_s")}
    robust, least = (lb.identify(PLAIN, **series, solver=s) for s in (lb.IRLS(), "ls"))
    far = np.abs(hinode["angles"]) > arcsec_to_rad(100.0)
    assert far.any() and robust.rejected[far].all()
    width = [np.ptp(found.interval[:, :2], axis=-1) for found in (robust, least)]
    assert (width[1] > 2.0 * width[0]).all()
