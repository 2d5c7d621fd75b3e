"""Do the tests notice? A seeded sample of one-line mutants of each room, against its own tests.

A mutant is one changed operator, comparison, constant or choice. It is killed when a test of its
room fails; only the tests that run the changed line are run, quickest first. Mutants that no test
can kill, since they compute the same, stand in equivalent_mutants.toml with the reason and are
counted apart. Needs fork.
"""

from __future__ import annotations

import argparse
import ast
import copy
import importlib.machinery
import os
import pickle
import random
import signal
import sys
import time
import tomllib
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
EQUIVALENT = Path(__file__).with_name("equivalent_mutants.toml")
ROOMS = ("estimation", "imaging", "pointing", "recording")
SEED, COUNT = 10, 200
RECORDING_S, STARTING_S, SLOWER = 3600, 60, 5  # limits of processor time

_OPPOSITE = [
    (ast.Add, ast.Sub),
    (ast.Mult, ast.Div),
    (ast.And, ast.Or),
    (ast.Eq, ast.NotEq),
    (ast.Is, ast.IsNot),
    (ast.In, ast.NotIn),
    (ast.Lt, ast.GtE),
    (ast.Gt, ast.LtE),
]
OPPOSITE: dict[type, type] = dict(_OPPOSITE) | {b: a for a, b in _OPPOSITE}
OFF_BY_ONE: dict[type, type] = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt}
_TWINS = {"min": "max", "minimum": "maximum", "any": "all", "floor": "ceil", "sin": "cos"}
TWINS = _TWINS | {b: a for a, b in _TWINS.items()}
SPARED_FIELDS = ("annotation", "returns", "decorator_list")
LOOKS = {"lw", "color", "fontsize", "figsize", "alpha", "ms", "ls", "ncols", "stacklevel", "dpi"}


@dataclass(frozen=True)
class Place:
    """A node that computes, its statement, and the function around it, if any."""

    path: Path
    tree: ast.Module
    node: ast.AST
    statement: ast.stmt
    function: ast.FunctionDef | None


@dataclass(frozen=True)
class Mutant:
    """One changed line, the code with the change, and the tests that run the line."""

    path: str
    line: int
    before: str
    after: str
    code: str
    tests: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.path}:{self.line}\n      {self.before}\n   -> {self.after}"


def spared(node: ast.AST) -> bool:
    """Whether it is a message, an assertion, the look of a picture, or a choice of axes."""
    match node:
        case ast.Call(func=ast.Attribute(attr="reshape")):
            return True
        case ast.Call(keywords=keywords):
            return any(keyword.arg in LOOKS for keyword in keywords)
        case ast.keyword(arg="axis") | ast.Subscript(value=ast.Attribute(attr="shape")):
            return True  # an axis counted from the end is another way to say the same
        case ast.keyword(arg="strict"):
            return True  # it asserts, as of two lists that are made alike
    return isinstance(node, ast.Raise | ast.JoinedStr | ast.Assert)


def places(path: Path) -> Iterator[Place]:
    """Every node of a file that computes something."""
    tree = ast.parse(path.read_text(encoding="utf-8"))

    def inside(node: ast.AST, statement: Any, function: Any) -> Iterator[Place]:
        for field, value in ast.iter_fields(node):
            for child in value if isinstance(value, list) else [value]:
                if not isinstance(child, ast.AST) or field in SPARED_FIELDS or spared(child):
                    continue
                within = child if isinstance(child, ast.FunctionDef) else function
                holder = child if isinstance(child, ast.stmt) else statement
                yield Place(path, tree, child, holder, within)
                yield from inside(child, holder, within)

    return inside(tree, None, None)


def changes(node: ast.AST) -> Iterator[tuple[str, Any]]:
    """An attribute of the node and what it becomes, for each mutant."""
    match node:
        case ast.Constant(value=bool(value)):
            yield "value", not value
        case ast.Constant(value=int(value)):
            yield "value", value + 1
        case ast.Constant(value=float(value)) if 0 < value < 1e-5:
            yield "value", 1e3 * value  # of a guard against rounding only the order means anything
        case ast.Constant(value=float(value)):
            yield from (
                ("value", each) for each in ((0.6 * value, 1.6 * value) if value else [1.0])
            )
        case ast.AugAssign(op=ast.Add() | ast.Sub()):
            yield "value", ast.Constant(0)
        case ast.AugAssign(op=ast.Mult() | ast.Div()):
            yield "value", ast.Constant(1)
        case ast.BinOp(op=op) | ast.BoolOp(op=op) if type(op) in OPPOSITE:
            yield "op", OPPOSITE[type(op)]()
        case ast.Compare(ops=[op], comparators=[ast.Constant(value=int())]) if (
            type(op) in OFF_BY_ONE
        ):
            yield "ops", [OFF_BY_ONE[type(op)]()]
        case ast.Compare(ops=[op]) if type(op) in OPPOSITE:
            yield "ops", [OPPOSITE[type(op)]()]
        case ast.UnaryOp(op=ast.USub()):
            yield "op", ast.UAdd()
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            yield "operand", ast.UnaryOp(ast.Not(), operand)
        case ast.Attribute(attr=name) if name in TWINS:
            yield "attr", TWINS[name]
        case ast.Name(id=name) if name in TWINS:
            yield "id", TWINS[name]


def mutant(place: Place, field: str, value: Any, runs: Runs) -> Mutant:
    """Make one change, write it down, and take it back."""
    before, kept = _line(place.statement), getattr(place.node, field)
    setattr(place.node, field, value)
    try:
        after, code = _line(place.statement), ast.unparse(place.tree)
    finally:
        setattr(place.node, field, kept)
    name = place.path.relative_to(ROOT).as_posix()
    return Mutant(name, place.node.lineno, before, after, code, runs.of(place))  # type: ignore[attr-defined]


def _line(statement: ast.stmt) -> str:
    """Return the statement without decorators and without what stands indented under it."""
    bare: Any = copy.copy(statement)
    if hasattr(bare, "body"):
        bare.body, bare.decorator_list, bare.orelse = [ast.Pass()], [], []
    return ast.unparse(bare).splitlines()[0]


@dataclass
class Runs:
    """Which tests run which line of which file, and how long each takes."""

    lines: dict[str, dict[int, set[str]]]
    seconds: dict[str, float]

    def of(self, place: Place) -> tuple[str, ...]:
        """Return the tests that would see a change of this place, quickest first."""
        here, function, statement = str(place.path), place.function, place.statement
        if function is None:  # run at import: whoever uses the file, or the name
            targets = getattr(statement, "targets", [])
            names = [target.id for target in targets if isinstance(target, ast.Name)]
            users = [file for file in self.lines if any(n in Path(file).read_text() for n in names)]
            numbered = [
                (file, line) for file in {here, *users} for line in self.lines.get(file, ())
            ]
        else:
            last = statement.body[0] if hasattr(statement, "body") else statement
            first = statement.body[0] if statement is function else statement
            end = function.end_lineno if statement is function else last.end_lineno
            numbered = [(here, line) for line in range(first.lineno, end + 1)]  # type: ignore[operator]
        tests = {t for file, line in numbered for t in self.lines.get(file, {}).get(line, ())}
        return tuple(sorted(tests & set(self.seconds), key=lambda test: self.seconds[test]))


class Recorder:
    """A plugin of pytest that takes down the `Runs`."""

    def __init__(self, room: str) -> None:
        import coverage

        self.coverage = coverage.Coverage(data_file=None, source=[str(ROOT / "losbench" / room)])
        self.seconds: dict[str, float] = {}

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        """Lines that follow are this test's."""
        self.coverage.switch_context(nodeid)

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Add up set-up, call and tear-down."""
        self.seconds[report.nodeid] = self.seconds.get(report.nodeid, 0.0) + report.duration


def pytest_here(arguments: list[str], plugins: list[object] | None = None) -> int:
    """Run pytest in this process, with nothing printed and no examples shrunk."""
    import hypothesis
    import pytest

    phases = [hypothesis.Phase.explicit, hypothesis.Phase.generate]
    hypothesis.settings.register_profile(
        "mutants", derandomize=True, database=None, deadline=None, phases=phases
    )
    hypothesis.settings.load_profile("mutants")
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    options = [
        "-x",
        "-q",
        "-p",
        "no:cacheprovider",
        "--assert=plain",
        "-n",
        "0",
        "--rootdir",
        str(ROOT),
    ]
    return int(pytest.main([*options, *arguments], plugins))


def in_child(function: Callable[[], Any], limit_s: float) -> Any:
    """Return what the function returns in a process of its own; None where that dies or takes
    longer than the limit of processor time, which a busy machine does not shorten.
    """
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        signal.setitimer(signal.ITIMER_PROF, limit_s)
        signal.alarm(20 * int(limit_s))  # whoever waits for nothing takes no processor time
        with os.fdopen(writer, "wb") as pipe:
            pickle.dump(function(), pipe)
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader, "rb") as pipe:
        written = pipe.read()
    return None if os.waitpid(child, 0)[1] else pickle.loads(written)


def record(room: str) -> Runs:
    """Run the tests of a room, its doctests too, and see who runs what."""
    runs = in_child(lambda: _recorded(room), RECORDING_S)
    if runs is None:
        raise SystemExit(f"the tests of {room} fail, or hang, without any mutant")
    return runs


def _recorded(room: str) -> Runs | None:
    recorder = Recorder(room)
    recorder.coverage.start()
    code = pytest_here([f"tests/{room}", f"losbench/{room}"], [recorder])
    recorder.coverage.stop()
    if code:
        return None
    data = recorder.coverage.get_data()
    lines = {
        file: {n: {t for t in tests if t} for n, tests in data.contexts_by_lineno(file).items()}
        for file in data.measured_files()
    }
    return Runs(lines, recorder.seconds)


def killed(changed: Mutant, runs: Runs) -> bool:
    """Whether a test fails, or never ends, in a process that imports the changed file."""

    def passes() -> bool:
        _load_changed(changed)
        return pytest_here(list(changed.tests)) == 0

    limit_s = STARTING_S + SLOWER * sum(runs.seconds[test] for test in changed.tests)
    return bool(changed.tests) and in_child(passes, limit_s) is not True


def _load_changed(changed: Mutant) -> None:
    """Let the import of that one file find the changed code; no file is written."""
    loader, path = importlib.machinery.SourceFileLoader, str(ROOT / changed.path)
    standing = loader.get_code

    def get_code(self: Any, name: str) -> Any:
        here = self.get_filename(name) == path
        return compile(changed.code, path, "exec") if here else standing(self, name)

    loader.get_code = get_code  # type: ignore[method-assign]


def sample(room: str, count: int, seed: int, runs: Runs) -> list[Mutant]:
    """Draw mutants of a room, all alike likely."""
    files = sorted((ROOT / "losbench" / room).rglob("*.py"))
    every = [(p, *change) for file in files for p in places(file) for change in changes(p.node)]
    drawn = random.Random(f"{seed} {room}").sample(every, min(count, len(every)))
    return [mutant(*one, runs) for one in drawn]


def equivalents() -> set[tuple[str, str, str]]:
    """Return file, line before and line after of the mutants that compute the same."""
    listed = tomllib.loads(EQUIVALENT.read_text(encoding="utf-8"))["mutant"]
    return {(each["file"], each["before"], each["after"]) for each in listed}


def main() -> None:
    """Draw, run, and print the rate and the survivors."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rooms", nargs="*", default=ROOMS, help="default: " + ", ".join(ROOMS))
    parser.add_argument("--seed", type=int, default=SEED, help=f"of the sample ({SEED})")
    parser.add_argument("--count", type=int, default=COUNT, help=f"mutants in all ({COUNT})")
    parser.add_argument("--jobs", type=int, default=2, help="processes (2)")
    parser.add_argument("--list", action="store_true", help="name every mutant, the killed too")
    options = parser.parse_args()
    os.chdir(ROOT)
    os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    sys.path.insert(0, str(ROOT))
    began, same = time.monotonic(), equivalents()
    dead = asked = drawn = 0
    share = -(-options.count // len(options.rooms))
    _preload()
    with ThreadPoolExecutor(options.jobs) as pool:
        every = dict(zip(options.rooms, pool.map(record, options.rooms), strict=True))
        for room, runs in every.items():
            mutants = sample(room, share, options.seed, runs)
            tried = [m for m in mutants if (m.path, m.before, m.after) not in same]
            found = dict(zip(tried, pool.map(partial(killed, runs=runs), tried), strict=True))
            died = sum(found.values())
            dead, asked, drawn = dead + died, asked + len(tried), drawn + len(mutants)
            print(f"{room}: {died} of {len(tried)} killed, {len(mutants) - len(tried)} equivalent")
            for each in sorted(map(str, (m for m in found if options.list or not found[m]))):
                print(f"   {each}", flush=True)
    minutes, rate = (time.monotonic() - began) / 60, 100 * dead / max(asked, 1)
    print(f"seed {options.seed}: {dead} of {asked} killed ({rate:.0f} %), ", end="")
    print(f"{drawn - asked} equivalent, {minutes:.1f} min")


def _preload() -> None:
    """Import once what every child needs, but losbench."""
    for name in (
        "hypothesis",
        "pytest",
        "pandas",
        "scipy.stats",
        "statsmodels.api",
        "matplotlib.figure",
    ):
        importlib.import_module(name)


if __name__ == "__main__":
    main()
