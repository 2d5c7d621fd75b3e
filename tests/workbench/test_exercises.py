"""The exercises: reference solutions are right for every seed, wrong answers never are, and nothing
is given away.
"""

import json
import warnings

import numpy as np
import pytest
from scipy.stats import norm

import losbench as lb
from losbench.resources import notebook_folder
from losbench.workbench.exercises import Exercises, student_copy

SOLUTIONS = json.loads(
    (notebook_folder() / "solutions" / "21-solutions.ipynb").read_text(encoding="utf-8")
)
STUDENTS = json.loads((notebook_folder() / "21-exercises.ipynb").read_text(encoding="utf-8"))
COUNT = 17


def judgements(notebook, seed):
    """Run the code cells as they stand, but for the seed; what each check said."""
    names, said = {}, []
    for cell in notebook["cells"]:
        if cell["cell_type"] != "code":
            continue
        lines = "".join(cell["source"]).replace("seed=1", f"seed={seed}").splitlines()
        if lines[-1].startswith("check.ex"):
            lines[-1] = f"judged = {lines[-1]}"
            exec("\n".join(lines), names)
            said.append(names["judged"])
        else:
            exec("\n".join(lines), names)
    return said


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 2026])
def test_the_solutions_are_right(seed):
    said = judgements(SOLUTIONS, seed)
    assert len(said) == COUNT
    assert [judged.text for judged in said if not judged.right] == []
    assert str(said[4]) == "ex05: right."


def test_the_students_copy_is_the_solutions_without_the_answers():
    assert student_copy(SOLUTIONS) == STUDENTS
    text = json.dumps(STUDENTS)
    assert text.count("answer = ...") == COUNT
    for secret in ("lb.irls(d.A, d.y).x", "tuned", "lb.mm(d.A", 'method=\\"mm\\"', "class Mine"):
        assert secret not in text


def test_the_students_copy_runs_as_it_is():
    for number, judged in enumerate(judgements(STUDENTS, 1), start=1):
        assert not judged.right
        assert judged.text == f"ex{number:02d}: not answered yet."


class Tukey:
    def weights(self, u):
        return lb.Bisquare(3.0).weights(u)


class Squares:
    def weights(self, u):
        return np.ones_like(u)


def wrong_answers(check):
    """For each exercise what a student may well try, and a word that the hint should have."""
    d = {number: check.data(number) for number in range(1, COUNT + 1)}
    two = lb.solve_attitude(d[13].points, d[13].shifts, method="ls")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield 1, d[1].y.mean(), "listens less"
        yield 1, np.median(d[1].y) + 1e-3, "default"
        yield 1, "nine", "form"
        yield 2, np.minimum(1.0, 1.345 / np.abs(d[2].residuals)), "compared with what"
        yield 2, 1.345 / np.abs(d[2].residuals / d[2].scale), "No row counts for more"
        yield 2, np.ones(3), "psi"
        yield 3, np.median(np.abs(d[3].residuals)), "divided"
        yield 3, d[3].residuals.std(), "median of the absolute"
        yield 4, 0.3, "larger"
        yield 4, 5.0, "smaller"
        yield 4, -1.0, "form"
        yield 5, len(d[5].y) // 2 + 1, "middle"
        yield 5, 0, "infinity"
        yield 6, 0, "Swap"
        yield 6, 1, "Swap"
        survived = lb.design_breakdown(
            lb.design_matrix(
                np.column_stack([d[7].u, d[7].v, np.ones_like(d[7].u)]), model="paper"
            ),
            group=np.repeat(np.arange(len(d[7].u)), 2),
        )
        yield 7, (survived.monotone, 0), "other number is right. Any estimate"
        yield 7, (survived.monotone + 5, survived.any), "other number is right. A monotone"
        yield 7, (9, 9), "not yet. Any estimate"
        yield 7, (1, 2, 3), "Two numbers"
        yield 7, 3, "form"
        yield 8, (0 if lb.lstsq(d[8].A, d[8].y).leverage.argmax() else 1, 0.5), "farthest"
        yield 8, (lb.lstsq(d[8].A, d[8].y).leverage.argmax(), 0.1), "hat matrix"
        yield 9, [19], "not alone"
        yield 9, [0, 1], "Some of these are good"
        yield 9, lb.mm(d[9].A, d[9].y).weights < 2.0, "Some of these are good"
        yield 9, [True], "form"
        yield 9, [18.5], "form"
        yield 9, [], "No row|one row at a time"
        yield 10, np.median(d[10].y), "watershed|large heap"
        yield 10, 1e6, "every weight is zero"
        yield 11, 1.0, "mean squares"
        yield 12, Tukey(), "doubt too early"
        yield 12, Squares(), "pull"
        yield 12, 3.0, "form"
        yield 13, two.angles, "how many spots of eight"
        yield 13, two.angles_arcsec, "radians"
        right = lb.solve_attitude(d[13].points, d[13].shifts, method="mm").angles
        for axis in range(3):
            flip = np.where(np.arange(3) == axis, -1.0, 1.0)
            yield 13, right * flip, "radians"
            yield 13, right * (flip > 0), "radians"
        yield 13, two.angles[:3], "400"
        yield 14, [(0, 0)], "missing"
        yield 14, [3, 5, 7], "form"
        yield 14, np.zeros((150, 2), dtype=bool), "missing"
        yield 14, np.zeros((2, 150), dtype=bool), "form"
        yield 14, [(f, s) for f in range(150) for s in (0, 1)][:40], "missing|So many"
        reach = np.hypot(d[15].u, d[15].v)
        yield 15, np.argsort(-reach)[:8], "turn while"
        yield 15, np.argsort(reach)[:8], "move most in a roll"
        yield 15, range(7), "Eight different"
        yield 15, [0] * 8, "Eight different"
        yield 15, range(8, 16), "form"
        held, factor = interval(d[16])
        yield 16, (0.95, factor), "promises"
        yield 16, (0.5 * held, factor), "Is yours of the slope"
        yield 16, (held, 1.96 * factor), "number of sigmas"
        yield 16, (held, 1.0), "95 of 100"
        yield 16, held, "form"
        passed, frames = power(d[17])
        yield 17, (1.0 - passed, frames), "let it pass"
        yield 17, (0.5, frames), "which standard deviation"
        yield 17, (passed, 0.5 * frames), "without a bias"
        yield 17, (passed, 2.0 * frames), "Fewer frames"


def interval(d):
    """Coverage of the drifts' intervals and what they lack, by counting."""
    fit = lb.lstsq(d.A, d.y)
    pull = np.sort(np.abs(fit.x[:, 1] - d.slope) / fit.std_error[:, 1])
    return np.searchsorted(pull, 1.96) / len(pull), pull[round(0.95 * len(pull))] / 1.96


def power(d):
    """How often a biased method passes, by scipy's distribution, and the frames by trying."""
    error = norm(d.bias, d.sigma / np.sqrt(d.frames))
    frames = 1
    while norm.cdf(d.tolerance * np.sqrt(frames) / d.sigma) < 0.975:
        frames += 1
    return error.cdf(d.tolerance) - error.cdf(-d.tolerance), frames


@pytest.mark.parametrize("seed", range(6))
def test_an_interval_that_lies_and_a_verdict_without_power_are_found_by_counting_too(seed):
    check = Exercises(seed=seed)
    assert check.ex16(interval(check.data(16))).right
    assert interval(check.data(16))[0] < 0.8
    passed, frames = power(check.data(17))
    assert check.ex17((passed, frames)).right
    assert passed > 0.02
    assert frames > check.data(17).frames


@pytest.mark.parametrize(
    "loss",
    [lb.Huber(1.2), lb.tuned(lb.Cauchy(), 0.92), lb.tuned(lb.Welsch(), 0.92)],
    ids=lambda loss: type(loss).__name__,
)
def test_a_loss_that_is_the_library_s_is_refused_under_any_name(loss):
    class Mine:
        def weights(self, u):
            return loss.weights(np.asarray(u))

    for answer, said in ((loss, "losbench's"), (Mine(), "with the constant")):
        text = Exercises().ex12(answer).text
        assert text.startswith("ex12: not yet. That is")
        assert type(loss).__name__ in text
        assert said in text


@pytest.mark.parametrize("seed", [1, 5, 77])
def test_right_answers_may_come_in_any_form(seed):
    check = Exercises(seed=seed)
    d = {number: check.data(number) for number in (1, 3, 4, 9, 14)}
    bad = lb.mm(d[9].A, d[9].y).weights == 0
    track = lb.track_attitude(d[14].points, d[14].shifts)
    c = lb.tuned(lb.Huber(), d[4].percent / 100).c
    for number, answer in [
        (1, np.round(lb.irls(d[1].A, d[1].y).x, 3)),
        (3, [np.median(np.abs(d[3].residuals)) / 0.6745]),
        *((4, c + change) for change in (-0.003, 0.003)),
        *(
            (9, form)
            for form in (
                bad,
                bad.tolist(),
                set(np.flatnonzero(bad)),
                np.where(bad),
                np.argwhere(bad),
            )
        ),
        *(
            (14, form)
            for form in (
                track.bad,
                np.nonzero(track.bad),
                set(zip(*np.nonzero(track.bad), strict=True)),
            )
        ),
    ]:
        assert getattr(check, f"ex{number:02d}")(answer).right, (number, answer)


def test_the_lab_s_tools_name_the_bad_rows_for_any_seed():
    for seed in range(60):
        check = Exercises(seed=seed)
        d = check.data(9)
        for doubted in (
            lb.lts(d.A, d.y).weights == 0,
            lb.mm(d.A, d.y).weights == 0,
            lb.mm(d.A, d.y).outliers(),
        ):
            assert check.ex09(np.flatnonzero(doubted)).right, seed
        everything = check.ex09(range(20))
        assert not everything.right


@pytest.mark.parametrize("seed", [1, 5])
def test_wrong_answers_get_a_hint(seed):
    check = Exercises(seed=seed)
    for number, answer, word in wrong_answers(check):
        judged = getattr(check, f"ex{number:02d}")(answer)
        assert not judged.right, (number, answer)
        assert judged.text.startswith(f"ex{number:02d}: not yet. ")
        assert any(part in judged.text for part in word.split("|")), (number, judged.text)


def test_data_differ_by_seed_and_repeat():
    one, again, other = Exercises(seed=1), Exercises(seed=1), Exercises(seed=2)
    for number in range(1, COUNT + 1):
        first, second = vars(one.data(number)), vars(again.data(number))
        assert all(np.array_equal(first[name], second[name]) for name in first)
        assert not any("hidden" in name or "truth" in name for name in first)
    assert not np.array_equal(one.data(1).y, other.data(1).y)


def test_names_and_seeds_are_checked():
    check = Exercises()
    assert {"ex01", "ex17", "data"} <= set(dir(check))
    with pytest.raises(AttributeError, match="no exercise 'ex18'; they are ex01 to ex17"):
        _ = check.ex18
    with pytest.raises(ValueError, match="number must be a whole number from 1 to 17, got 0"):
        check.data(0)
    with pytest.raises(ValueError, match="seed must be a whole number of at least 0, got -1"):
        Exercises(seed=-1)
