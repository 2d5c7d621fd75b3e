"""Every notebook with an explorer, in JupyterLab: it runs, follows key and mouse, refuses nonsense,
and comes back.
"""

import json
import re

import pytest
from explorer_page import ExplorerPage
from lab import ask_kernel, raised

pytestmark = [pytest.mark.browser, pytest.mark.xdist_group("browser")]

_FIND = (
    "from ipywidgets.widgets.widget import _instances; "
    "explorer = next(w for w in _instances.values() if hasattr(w, 'ask'))"
)
_COUNT = "import ipywidgets.widgets.widget as w; print(len(w._instances))"


@pytest.fixture(scope="module")
def page(browser, lab, explorer_notebook, screenshots):
    """A notebook, opened and run; its tests share it, since that takes most of their time."""
    with browser.new_context(viewport={"width": 1280, "height": 1000}) as context:
        page = context.new_page()
        lab.open(page, explorer_notebook)
        lab.run_all(page)
        ExplorerPage(page).picture.scroll_into_view_if_needed()
        page.screenshot(path=screenshots / f"{explorer_notebook.removesuffix('.ipynb')}.png")
        yield page
    lab.delete_sessions()


@pytest.fixture
def opened(page):
    explorer = ExplorerPage(page)
    explorer.button("reset").click()
    page.wait_for_timeout(500)
    return explorer


def asked_for(explorer, number):
    """What the picture must say once the slider's readout is its value."""
    _, readout = explorer.slider(number)
    label = explorer.box.locator(".widget-slider .widget-label").nth(number).inner_text()
    name, unit = re.fullmatch(r"(.*?)(?: \(([^()]*)\))?", label).groups()
    value = float(readout.inner_text().replace("−", "-"))
    return f"{name} {value:g} {unit or ''}".strip()


def wait_until_settled(readout, before):
    """Return when the readout is another one than before, and stays: that of a log slider comes
    from the kernel.
    """
    now = before
    for _ in range(50):
        readout.page.wait_for_timeout(200)
        earlier, now = now, readout.inner_text()
        if before != now == earlier:
            return
    raise AssertionError(f"the readout was {before} and is {now}")


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
        wait_until_settled(readout, before)
        opened.wait_until_shown(lambda number=number: asked_for(opened, number))
    opened.drag(0)
    opened.wait_until_shown(lambda: asked_for(opened, 0))
    assert opened.shown() != first
    reset = opened.button("reset")
    reset.focus()
    page.keyboard.press("Enter")
    for setting in first.split("; "):
        opened.wait_until_shown(setting)
    assert opened.shown() == first
    notes = opened.box.get_by_role("alert").filter(has_text="Note").all_inner_texts()
    assert all("did not converge" in note for note in notes)


def test_nothing_is_cut_off_and_only_numbers_can_be_typed(opened):
    assert opened.cut_off() == []
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
    assert raised(opened.page) == []


def test_what_a_callback_raises_would_be_noticed(opened):
    """The check that the other tests rest on: such errors reach the log, but no cell."""
    page = opened.page
    ask_kernel(page, f"{_FIND}; explorer.update = lambda **_: 1 / 0")
    opened.button("new noise").click()
    page.wait_for_function("() => window.raised.length > 0", timeout=5_000)
    assert raised(page) == ["ZeroDivisionError: division by zero"]
    ask_kernel(page, f"{_FIND}; del explorer.update")
    page.evaluate("() => { window.raised.length = 0; }")


def test_running_the_cells_again_leaves_no_live_widgets_behind(lab, opened):
    page = opened.page
    lab.run_all(page)
    ExplorerPage(page).shown()
    before = json.loads(ask_kernel(page, _COUNT))
    for _ in range(3):
        lab.run_all(page)
        ExplorerPage(page).shown()
    assert json.loads(ask_kernel(page, _COUNT)) == before
