"""Marking by hidden seeds: all, none and all but one; and what stops or breaks is said, not marked."""

import csv
import json
import os

import pytest

from losbench.cli import main
from losbench.resources import notebook_folder
from losbench.workbench.exercises.desk import EXERCISES, student_copy
from losbench.workbench.exercises.marking import mark_folder

SOLUTIONS = json.loads(
    (notebook_folder() / "solutions" / "21-solutions.ipynb").read_text(encoding="utf-8")
)
SETUP = "from losbench.workbench.exercises import Exercises\ncheck = Exercises(seed=1)"
ASK = "for guess in range(1, 30):\n    if check.ex05(guess).right:\n        break"


def write(path, *sources):
    """Write a notebook of the solutions' form with these code cells."""
    cell = {"cell_type": "code", "execution_count": None, "metadata": {}, "outputs": []}
    cells = [{**cell, "id": f"c{k}", "source": source} for k, source in enumerate(sources)]
    path.write_text(json.dumps({**SOLUTIONS, "cells": cells}), encoding="utf-8")


@pytest.mark.slow
def test_solutions_an_empty_copy_and_a_number_typed_in(tmp_path, capsys):
    folder = tmp_path / "handed in"
    (folder / "ann").mkdir(parents=True)
    typed = json.loads(json.dumps(SOLUTIONS))
    cell = next(cell for cell in typed["cells"] if cell["id"] == "21-wild")
    cell["source"] = ["d = check.data(1)\n", "answer = 6.914\n", "check.ex01(answer)"]
    for name, notebook in (
        ("ann/21", SOLUTIONS),
        ("bob", student_copy(SOLUTIONS)),
        ("cat", typed),
    ):
        (folder / f"{name}.ipynb").write_text(json.dumps(notebook), encoding="utf-8")
    out = tmp_path / "marks.csv"
    assert main(["exercises", "mark", str(folder), "--seeds", "2", "--out", str(out)]) == 0
    with out.open(encoding="utf-8") as file:
        rows = {row["notebook"]: row for row in csv.DictReader(file)}
    count = len(EXERCISES)
    right = {name: float(row["right"]) for name, row in rows.items()}
    assert right == {"ann/21.ipynb": count, "bob.ipynb": 0, "cat.ipynb": count - 1}
    assert rows["cat.ipynb"]["ex01"] == "0.00"
    assert not any(row["problem"] for row in rows.values())
    assert "Seeds " in capsys.readouterr().out


@pytest.mark.slow
def test_what_breaks_is_said_and_not_marked_and_a_loop_of_guesses_earns_nothing(tmp_path):
    write(tmp_path / "a.ipynb", "import losbenhc")
    write(tmp_path / "b.ipynb", SETUP, ASK)
    write(tmp_path / "c.ipynb", SETUP, "1 / 0", "check.ex06(None)")
    write(tmp_path / "d.ipynb", "1")
    found = {mark.notebook[0]: mark for mark in mark_folder(tmp_path, [4, 5], seconds=60)}
    assert found["a"].problem.startswith("code cell 1: ModuleNotFoundError")
    assert found["a"].row()["right"] == ""
    assert found["b"].right == 0
    assert found["c"].right == 1
    assert found["c"].problem == "code cell 2: ZeroDivisionError: division by zero"
    assert found["d"].problem == "no cell makes Exercises"


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="memory is limited on POSIX alone")
def test_time_and_memory_are_limited(tmp_path):
    (tmp_path / "slow").mkdir()
    (tmp_path / "large").mkdir()
    write(tmp_path / "slow" / "a.ipynb", "while True:\n    pass")
    write(tmp_path / "large" / "a.ipynb", "bytearray(3 * 2**30)")
    slow = next(mark_folder(tmp_path / "slow", [1], seconds=2))
    assert slow.problem == "not done after 2 s"
    large = next(mark_folder(tmp_path / "large", [1], memory_mb=2048))
    assert "MemoryError" in large.problem


def test_a_folder_without_notebooks_is_refused(tmp_path, capsys):
    assert main(["exercises", "mark", str(tmp_path)]) == 2
    assert "must hold notebooks (*.ipynb), but there is none" in capsys.readouterr().err
