"""What a notebook shows of a result: numbers with errors, a dozen lines, nothing unescaped."""

import re

import numpy as np
import pytest

import losbench as lb
from losbench.display import html_table, table, with_error

RNG = np.random.default_rng(1)
A, Y = RNG.standard_normal((9, 2)), RNG.standard_normal((40, 9))
POINTS = [[5.0, 0.0, 260.0], [-5.0, 0.0, 260.0], [0.0, 5.0, 260.0]]
SHIFTS = 1e-3 * RNG.standard_normal((40, 3, 2))
SHIFTS[3] = np.nan
RESULTS = {
    "one fit": lb.irls(A, Y[0]),
    "fits": lb.irls(A, Y, max_iter=500),
    "grid of fits": lb.lstsq(A, Y.reshape(4, 10, 9)),
    "one attitude": lb.solve_attitude(POINTS, SHIFTS[0]),
    "attitudes": lb.solve_attitude(POINTS, SHIFTS, max_iter=500),
}


@pytest.mark.parametrize("result", RESULTS.values(), ids=RESULTS)
def test_a_result_shows_itself_on_a_dozen_lines(result):
    html = result._repr_html_()
    lines = html.count("<tr>") + 1 + (not html.endswith("</table></div>"))
    assert lines <= 12
    assert "±" in html
    assert not re.search(r"<(?!/?(div|b|table|tr|th|td)\b)", html)
    size = np.prod(np.shape(result.scale), dtype=int)
    assert len(result.to_frame()) == size
    if size > 8:
        assert f"... and {size - 8} more: .to_frame() has all" in html


def test_a_table_holds_the_numbers_of_the_fit():
    fit, frame = RESULTS["grid of fits"], RESULTS["grid of fits"].to_frame()
    np.testing.assert_array_equal(frame["x1"], fit.x[..., 1].ravel())
    np.testing.assert_array_equal(frame["std_error0"], fit.std_error[..., 0].ravel())
    assert frame.index.names == ["axis0", "axis1"]
    assert frame.loc[(2, 3), "scale"] == fit.scale[2, 3]
    angles = RESULTS["attitudes"].to_frame()
    assert angles.index.name == "solve"
    assert not angles.loc[3, "ok"]
    np.testing.assert_array_equal(
        angles["sigma_gamma_arcsec"], RESULTS["attitudes"].std_error_arcsec[:, 2]
    )


def test_what_is_wrong_is_said_in_words():
    html = RESULTS["attitudes"]._repr_html_()
    assert "too few spots" in html
    assert "none" in html
    with pytest.warns(RuntimeWarning, match="do not determine"):
        assert "error unknown" in lb.lstsq(np.ones((9, 2)), Y[0])._repr_html_()


class Wild:
    """A loss whose name would be markup."""

    def weights(self, u):
        return np.ones_like(u)

    def __repr__(self):
        return "<script>alert(1)</script>"


def test_names_from_outside_are_escaped():
    html = lb.irls(A, Y[0], loss=Wild())._repr_html_()
    assert "<script" not in html
    assert "&lt;script&gt;" in html
    assert "<i>" not in html_table("<i>", ["<i>"], [["<i>"]], count=1, note="<i>")


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (0.0, 0.25, "0.00 ± 0.25"),
        (-3.14159, 0.0012, "-3.1416 ± 0.0012"),
        (123456.7, 89.0, "123457 ± 89"),
        (1.5, 20.0, "2 ± 20"),
        (2.0e9, 3.0e7, "(2.000 ± 0.030)e+09"),
        (5.0, np.inf, "5, error unknown"),
        (5.0, 0.0, "5"),
        (np.inf, 1.0, "inf"),
    ],
)
def test_a_number_has_two_digits_of_its_error(value, error, text):
    assert with_error(value, error) == text


def test_a_table_of_one_system_has_one_row():
    assert table({"x": np.float64(3.0)}, axes=["system"]).shape == (1, 1)
