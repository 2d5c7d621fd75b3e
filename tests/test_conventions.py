"""What every public name, notebook and tracked file keeps to."""

import ast
import inspect
import json
import re
import shutil
import subprocess
from enum import Enum
from pathlib import Path

import pytest

import losbench as lb
from losbench.resources import notebook_folder

ROOT = Path(__file__).resolve().parent.parent
STUB = Path(lb.__file__).with_name("__init__.pyi")
PUBLIC = [
    alias.asname
    for node in ast.parse(STUB.read_text(encoding="utf-8")).body
    if isinstance(node, ast.ImportFrom)
    for alias in node.names
]
ROOMS = [name for name in PUBLIC if inspect.ismodule(getattr(lb, name))]
NOTEBOOKS = sorted(notebook_folder().glob("*.ipynb"))
SHAPE = re.compile(r"\) array|shape \(")


@pytest.mark.parametrize("name", sorted(set(PUBLIC) - set(ROOMS)))
def test_a_public_name_is_documented_and_typed(name):
    thing = getattr(lb, name)
    text = inspect.getdoc(thing) or ""
    assert len(text.splitlines()[0]) > 10, f"{name} says nothing of itself"
    assert ">>>" in text or SHAPE.search(text), f"{name} shows neither an example nor a shape"
    if inspect.isclass(thing) and (
        issubclass(thing, Enum | Exception) or getattr(thing, "_is_protocol", False)
    ):
        return  # values, errors, or what others must have: no parameters of its own
    signature = inspect.signature(thing)
    untyped = [p.name for p in signature.parameters.values() if p.annotation is p.empty]
    assert not untyped, f"{name} leaves {', '.join(untyped)} without a type"
    assert inspect.isclass(thing) or signature.return_annotation is not signature.empty


def test_the_stub_lists_what_the_package_offers():
    assert set(PUBLIC) == set(dir(lb)) - {"__version__"}


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_stored_clean(path):
    notebook = json.loads(path.read_text(encoding="utf-8"))
    ids = [cell["id"] for cell in notebook["cells"]]
    assert len(set(ids)) == len(ids)
    for id_ in ids:
        assert re.fullmatch(rf"{path.stem[:2]}-[a-z0-9-]+", id_), (
            f"cell id {id_!r} should read {path.stem[:2]}-some-name"
        )
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            assert not cell["outputs"], f"cell {cell['id']} is stored with outputs"
            assert cell["execution_count"] is None, (
                f"cell {cell['id']} is stored with an execution count"
            )
    assert notebook["nbformat"] == 4
    assert notebook["nbformat_minor"] == 5
    assert notebook["metadata"]["kernelspec"]["name"] == "python3"
    assert notebook["cells"][0]["source"][0].startswith("# ")


@pytest.mark.parametrize("name", sorted(path.name for path in ROOT.glob("*.lock")))
def test_a_lock_pins_every_package_by_hash_and_names_no_address(name):
    text = (ROOT / name).read_text(encoding="utf-8")
    assert "://" not in text
    entries = re.split(r"\n(?=[A-Za-z0-9])", text.strip())
    assert len(entries) > 100
    for entry in entries:
        assert re.match(r"[A-Za-z0-9._-]+==\S+", entry)
        assert "--hash=sha256:" in entry


def test_no_tracked_file_knows_the_machine_that_it_was_written_on():
    if not (ROOT / ".git").exists() or shutil.which("git") is None:
        pytest.skip("not a git checkout")
    pattern = r"(^|[^A-Za-z0-9_.])/(home/[a-z]+|Users/[a-z]+|root|work|mnt)/"
    found = subprocess.run(
        ["git", "grep", "-nIE", pattern, "--", ".", ":!*.lock"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert found.returncode in (0, 1), found.stderr
    assert found.stdout == ""


def test_the_first_notebook_leads_to_all_the_others():
    text = (notebook_folder() / "00-start-here.ipynb").read_text(encoding="utf-8")
    assert set(re.findall(r"\]\(([^)]+\.ipynb)\)", text)) == {path.name for path in NOTEBOOKS[1:]}


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_imports_from_the_face_and_named_subpackages_only(path):
    """A subpackage is a folder, whose ``__init__`` says what it offers; files are the library's own business."""
    package = Path(lb.__file__).parent.parent
    code = "\n".join(
        "".join(cell["source"])
        for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]
        if cell["cell_type"] == "code"
    )
    for module in re.findall(r"^\s*(?:from|import) (losbench[\w.]*)", code, re.MULTILINE):
        where = package / module.replace(".", "/")
        assert where.is_dir() or module.split(".")[1] in ROOMS, f"{module} is a file of the library"


def test_what_every_array_is_called_is_said_once():
    package = Path(lb.__file__).parent
    again = [
        path.name
        for path in package.rglob("*.py")
        if re.search(
            r"^(Floats|Bools|Ints|Indices|Pixels)\b.* = ",
            path.read_text(encoding="utf-8"),
            re.MULTILINE,
        )
    ]
    assert again == ["arrays.py"]
