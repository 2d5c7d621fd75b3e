"""Exercises on robust estimation: data that differ by seed, and checks that say right or what to
think about.

A check never says the answer. Each exercise is a pair of functions, one that draws its data and one
that judges; a judge returns an empty text for a right answer and a question or hint for any other.
"""

from losbench.workbench.exercises.desk import Exercises as Exercises
from losbench.workbench.exercises.desk import student_copy as student_copy
