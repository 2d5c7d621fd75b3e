"""What the root of the checkout promises: documents, metadata and commands that hold."""

import ast
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import losbench as lb

ROOT = Path(__file__).resolve().parent.parent
if not (ROOT / "CONTRIBUTING.md").is_file():
    pytest.skip("needs a checkout", allow_module_level=True)

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
QUESTION = re.compile(r"^\| (.*\?) \| \[(.*?)\]\((.*?)\) \| `(.*?)` \|$", re.MULTILINE)
QUESTIONS = QUESTION.findall((ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"))
DISTRIBUTION = {  # where a package is not called what it is imported as
    "bs4": "beautifulsoup4",
    "cv2": "opencv-python-headless",
    "erfa": "pyerfa",
    "IPython": "ipython",
    "PIL": "pillow",
    "skfem": "scikit-fem",
    "yaml": "pyyaml",
}
BY_HAND = {"batoid", "picasso"}  # in an environment of its own; the script says how
OWN = {"losbench", *BY_HAND, *(path.stem for path in ROOT.glob("tests/**/*.py"))} | {
    path.stem for path in ROOT.glob("benchmarks/*.py")
}
ON_DEMAND = ["bench", "compare", "mutants", "test-floor"]


def imports(folder):
    """Every outside package that a folder imports, by where."""
    found = {}
    for path in sorted((ROOT / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            else:
                names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            for name in names:
                found.setdefault(name.partition(".")[0], path.relative_to(ROOT).as_posix())
    return {
        name: where for name, where in found.items() if name not in {*sys.stdlib_module_names, *OWN}
    }


def declared(*extras):
    lists = [PROJECT["dependencies"], *(PROJECT["optional-dependencies"][name] for name in extras)]
    return {re.match(r"[\w-]+", each).group().lower() for names in lists for each in names}


@pytest.mark.parametrize(
    ("folder", "extras"),
    [
        ("losbench", ["fits", "hdf5", "tiff", "cluster"]),
        ("tests", ["fits", "hdf5", "tiff", "test", "cluster", "data", "browser"]),
        ("benchmarks", ["fits", "hdf5", "test", "mutants", "bench", "cluster"]),
        ("data", ["data"]),
    ],
)
def test_every_package_that_is_imported_is_declared(folder, extras):
    names = {
        DISTRIBUTION.get(name, name).replace("_", "-").lower(): where
        for name, where in imports(folder).items()
    }
    missing = {name: where for name, where in names.items() if name not in declared(*extras)}
    assert not missing


def test_every_package_that_is_declared_is_used():
    """JupyterLab is where the notebooks are opened, xdist how the tests are run; nothing imports them."""
    used = {
        DISTRIBUTION.get(name, name).replace("_", "-").lower()
        for folder in ("losbench", "tests")
        for name in imports(folder)
    }
    assert declared("fits", "test") - used == {"jupyterlab", "pytest-xdist"}


def test_the_floor_lock_pins_the_floors():
    lock = (ROOT / "requirements-floor.lock").read_text(encoding="utf-8")
    pinned = dict(re.findall(r"^([a-z0-9-]+)==([\d.]+)", lock, re.MULTILINE))
    extras = PROJECT["optional-dependencies"]
    for each in (*PROJECT["dependencies"], *extras["fits"], *extras["hdf5"], *extras["test"]):
        name, floor = re.match(r"([\w-]+)>=([\d.]+)", each).groups()
        assert (pinned[name] + ".").startswith(floor + ".") or pinned[name] == floor + ".0", each


def test_all_versions_are_the_same():
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.search(r"^version: (.*)$", citation, re.MULTILINE)[1] == lb.__version__
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.search(r"^## ([\d.]+)", changes, re.MULTILINE)[1] == lb.__version__


def test_the_python_versions_are_the_same_everywhere():
    named = {
        name.rpartition(" :: ")[2]
        for name in PROJECT["classifiers"]
        if re.search(r":: 3\.\d+$", name)
    }
    workflow = (ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8")
    assert set(re.findall(r'"(3\.\d+)"', re.search(r"python: \[(.*)\]", workflow)[1])) == named
    assert min(named, key=lambda name: int(name[2:])) == PROJECT["requires-python"].removeprefix(
        ">="
    )


def test_ten_questions_of_a_reader_are_answered():
    assert len(QUESTIONS) == 10


@pytest.mark.parametrize(
    ("question", "shown", "path", "thing"), QUESTIONS, ids=[q[3] for q in QUESTIONS]
)
def test_the_answer_to_a_question_is_where_it_is_said_to_be(question, shown, path, thing):
    assert shown == path
    text = (ROOT / path).read_text(encoding="utf-8")
    assert re.search(rf"^\s*{re.escape(thing)}\b", text, re.MULTILINE), question


@pytest.mark.parametrize(
    "name",
    [
        *("README.md", "README.zh-CN.md", "CONTRIBUTING.md", "RELEASING.md"),
        *("SECURITY.md", "environment.md"),
    ],
)
def test_links_to_files_lead_somewhere(name):
    for target in re.findall(
        r"\]\(((?!https?:|#)[^)#]+)", (ROOT / name).read_text(encoding="utf-8")
    ):
        assert (ROOT / target).exists(), target


def test_the_students_archive_leaves_out_every_file_that_holds_answers():
    if not (ROOT / "notebooks" / "solutions").is_dir():
        pytest.skip("this is the students' archive")
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    left_out = re.search(r"^FOR_TEACHERS := (.*)$", makefile, re.MULTILINE)[1].split()
    assert all((ROOT / path).exists() for path in left_out)
    answer = "np.minimum(1.0, 1.345 / np.abs(d" + ".residuals"
    holding = [
        path.relative_to(ROOT).as_posix()
        for folder in ("notebooks", "tests", "docs", "losbench", "benchmarks")
        for path in (ROOT / folder).rglob("*")
        if path.suffix in (".ipynb", ".py", ".md") and answer in path.read_text(encoding="utf-8")
    ]
    assert holding
    assert all(path.startswith(tuple(left_out)) for path in holding), holding


@pytest.mark.skipif(shutil.which("make") is None, reason="needs make")
@pytest.mark.parametrize("target", ON_DEMAND)
def test_what_is_run_on_demand_can_be_started(target):
    done = subprocess.run(
        ["make", "-n", target, "OLD=main"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert target in (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    for script in set(re.findall(r"benchmarks/\w+\.py", done.stdout)):
        assert (ROOT / script).is_file()


def test_every_mutant_that_is_called_equivalent_can_still_be_made():
    spec = importlib.util.spec_from_file_location("mutants", ROOT / "benchmarks" / "mutants.py")
    mutants = importlib.util.module_from_spec(spec)
    sys.modules["mutants"] = mutants
    spec.loader.exec_module(mutants)
    listed, made = mutants.equivalents(), set()
    runs = mutants.Runs({}, {})
    for file in {file for file, _, _ in listed}:
        lines = {before for name, before, _ in listed if name == file}
        for place in mutants.places(ROOT / file):
            if mutants._line(place.statement) in lines:
                for change in mutants.changes(place.node):
                    mutant = mutants.mutant(place, *change, runs)
                    made.add((mutant.path, mutant.before, mutant.after))
    assert listed <= made


@pytest.mark.parametrize(
    "script", ["compare.py", "mutants.py", "soak_explorers.py", "bench_centroid.py"]
)
def test_a_script_says_how_it_is_used(script):
    done = subprocess.run(
        [sys.executable, ROOT / "benchmarks" / script, "--help"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "usage:" in done.stdout


def test_what_benches_record_can_be_kept_and_shown():
    """Also of those that take a browser, or many minutes: their rows, of made-up numbers."""
    program = """
import json, bench_coverage, bench_explorers, bench_study, bench_telemetry, page
names = bench_explorers.Row.__dataclass_fields__
explorer = bench_explorers.Row(**{**dict.fromkeys(names, 1.5), "explorer": "A<B", "verdict": "MISSED"})
rows = [
    *bench_telemetry.rows_of(60.0, 1000.5),
    bench_coverage.row_of("white  noise    0.951 0.949  ok"),
    bench_explorers.recorded(explorer),
]
for row in json.loads(json.dumps(rows)):
    print(page.row_of(row))
"""
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=ROOT / "benchmarks",
        env=os.environ | threads,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    took, held, coverage, explorer = done.stdout.splitlines()
    assert ">1000000 rows<" in took and ">60 s<" in took and 'class="ok"' in took
    assert ">1000000 rows: 1000 MB<" in held and 'class="MISSED"' in held
    assert ">white noise 0.951 0.949<" in coverage and 'class="ok"' in coverage
    assert ">A&lt;B<" in explorer and ">1.5 ms<" in explorer and 'class="MISSED"' in explorer


def test_the_proof_runs_nothing_that_is_for_demand_only():
    proof = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert set(re.findall(r"^make (\S+)", proof, re.MULTILINE)) == {"reproduce", "test"}
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in ("reproduce", "test"):
        assert not set(ON_DEMAND) & set(
            re.search(rf"^{target}:(.*?)##", makefile, re.MULTILINE)[1].split()
        )
