"""Every notebook with an explorer, in JupyterLab: it runs, follows key and mouse, refuses nonsense, and comes back."""

import json
import re

import pytest
from explorer_page import ExplorerPage

pytestmark = pytest.mark.browser

# How many widgets live, and which picture is shown, asked of the kernel in the page.
_ASK = """async (code) => {
    const kernel = window.jupyterapp.shell.currentWidget.sessionContext.session.kernel;
    const future = kernel.requestExecute({code, store_history: false});
    let text = '';
    future.onIOPub = message => { if (message.header.msg_type === 'stream') text += message.content.text; };
    await future.done;
    return text;
}"""
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
    value = float(readout.inner_text())
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
        page.wait_for_timeout(50)
        assert readout.inner_text() != before
        opened.wait_until_shown(asked_for(opened, number))
    opened.drag(0)
    opened.wait_until_shown(asked_for(opened, 0))
    assert opened.shown() != first
    reset = opened.button("reset")
    reset.focus()
    page.keyboard.press("Enter")
    for setting in first.split("; "):
        opened.wait_until_shown(setting)
    assert opened.shown() == first
    assert (
        opened.box.get_by_role("alert").count() == 0
        or "did not converge" in opened.box.get_by_role("alert").inner_text()
    )


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
    outputs = opened.page.locator(".jp-NotebookPanel:not(.lm-mod-hidden) .jp-OutputArea-output").all_inner_texts()
    assert not any("Traceback" in text for text in outputs)


def test_running_the_cells_again_leaves_no_live_widgets_behind(lab, opened):
    page = opened.page
    lab.run_all(page)
    ExplorerPage(page).shown()
    before = json.loads(page.evaluate(_ASK, _COUNT))
    for _ in range(3):
        lab.run_all(page)
        ExplorerPage(page).shown()
    assert json.loads(page.evaluate(_ASK, _COUNT)) == before
