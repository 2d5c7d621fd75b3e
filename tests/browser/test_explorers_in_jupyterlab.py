"""Every explorer of the notebooks, in JupyterLab by night: it follows key and mouse, refuses
nonsense, fits a narrow window, and comes back. What else the notebooks compute `make reproduce` runs.
"""

import re

import nbformat
import pytest
from explorer_page import ExplorerPage
from lab import asked_outside, raised, settle, use_size, use_theme

from losbench.resources import notebook_folder
from losbench.workbench import explorers

pytestmark = pytest.mark.browser

HOLDING = "Explorer("


def explorers_of(path):
    cells = nbformat.read(path, 4).cells
    return [
        re.search(r"(\w+Explorer)\(", cell.source)[1]
        for cell in cells
        if cell.cell_type == "code" and HOLDING in cell.source
    ]


# Notebook, its how manieth explorer, and which one that is.
PLACES = [
    (path.name, number, kind)
    for path in sorted(notebook_folder().glob("*.ipynb"))
    for number, kind in enumerate(explorers_of(path))
]


@pytest.fixture(scope="module", autouse=True)
def dark(lab, page):
    lab.show(page, PLACES[0][0], holding=HOLDING)
    use_theme(page, "Dark")
    yield
    use_theme(page, "Light")


@pytest.fixture(scope="module", params=PLACES, ids=lambda at: f"{at[0][:2]}-{at[2]}")
def place(request, dark, lab, page, screenshots):
    """The number of an explorer in the notebook in front; what looks at it shares it."""
    name, number, kind = request.param
    lab.show(page, name, holding=HOLDING)
    ExplorerPage(page, number).picture.scroll_into_view_if_needed()
    page.screenshot(path=screenshots / f"{name[:2]}-{kind}.png")
    return number


@pytest.fixture
def opened(page, place):
    explorer = ExplorerPage(page, place)
    explorer.reset()
    return explorer


def test_every_explorer_stands_in_a_notebook():
    assert {kind for _, _, kind in PLACES} == set(explorers.__all__)


def asked_for(explorer, number):
    """What the picture must say once the slider's readout is its value."""
    _, readout = explorer.slider(number)
    label = explorer.box.locator(".widget-slider .widget-label").nth(number).inner_text()
    name, unit = re.fullmatch(r"(.*?)(?: \(([^()]*)\))?", label).groups()
    value = float(readout.inner_text().replace("−", "-"))
    return f"{name} {value:g} {unit or ''}".strip()


def test_key_mouse_and_reset(opened):
    page = opened.page
    first = opened.shown()
    count = opened.box.locator(".widget-slider").count()
    assert count > 2
    for number in range(count):
        handle, readout = opened.slider(number)
        before = readout.inner_text()
        handle.focus()
        page.keyboard.press("ArrowRight")
        page.keyboard.press("ArrowRight")
        settle(page)
        assert readout.inner_text() != before
        opened.wait_until_shown(asked_for(opened, number))
    opened.drag(0, steps=20, seconds=0.4)
    settle(page)
    opened.wait_until_shown(asked_for(opened, 0))
    assert opened.shown() != first
    opened.button("reset").focus()
    page.keyboard.press("Enter")
    for setting in first.split("; "):
        opened.wait_until_shown(setting)
    assert opened.shown() == first
    notes = opened.box.get_by_role("alert").filter(has_text="Note").all_inner_texts()
    assert all("did not converge" in note for note in notes)


def test_nothing_is_cut_off_and_only_numbers_can_be_typed(opened):
    assert (opened.cut_off(), opened.too_wide()) == ([], [])
    assert opened.box.bounding_box()["height"] <= 680
    for number in range(opened.box.locator(".widget-slider").count()):
        _, readout = opened.slider(number)
        before = readout.inner_text()
        if readout.get_attribute("contenteditable") == "true":
            readout.fill("banana")
            readout.press("Enter")
        assert readout.inner_text() == before


def test_nonsense_in_a_field_is_said_in_the_widget(opened):
    first = opened.shown()
    field = opened.field("seed")
    field.fill("abc")
    field.press("Enter")
    alert = opened.box.get_by_role("alert").filter(has_text="seed must be a number, got 'abc'")
    alert.wait_for(timeout=5_000)
    assert opened.shown() == first
    opened.button("new noise").click()
    opened.wait_until_shown("seed 0")
    alert.wait_for(state="detached", timeout=5_000)


def test_a_narrow_window_shows_all_of_it(opened, screenshots):
    page = opened.page
    use_size(page, 700, 800)
    page.screenshot(path=screenshots / "narrow.png")
    assert (opened.cut_off(), opened.too_wide()) == ([], [])
    use_size(page, 1280, 800)


def test_nothing_was_asked_outside_and_no_callback_failed(lab, page, place):
    assert asked_outside(page, lab.url) == []
    assert raised(page) == []
