"""Notebook 20 in JupyterLab: all nine scenes on one page follow the arrow keys without an
error.
"""

import re

import pytest
from explorer_page import ExplorerPage
from lab import asked_outside, raised, settle, use_size, use_theme

from losbench.workbench.explorers import lab as scenes

pytestmark = pytest.mark.browser

NOTEBOOK = "20-robust-estimation-lab.ipynb"
ORDER = [
    scenes.DragPoint,
    scenes.LossShapes,
    scenes.BreakdownMeter,
    scenes.ScaleIsTheHero,
    scenes.Leverage,
    scenes.Masking,
    scenes.Basins,
    scenes.MMActs,
    scenes.YourLayout,
]

# From the key to the first frame of the screen after the new picture has been decoded.
_PRESS = """async ([handle, index]) => {
    const picture = () => document.querySelectorAll('.jp-NotebookPanel:not(.lm-mod-hidden) img.losbench-picture')[index];
    const before = picture().src, start = performance.now();
    handle.dispatchEvent(new KeyboardEvent('keydown', {key: 'ArrowRight', bubbles: true}));
    while (picture().src === before) {
        if (performance.now() - start > 10000) throw new Error('no new picture');
        await new Promise(requestAnimationFrame);
    }
    await picture().decode();
}"""


@pytest.fixture(autouse=True)
def shown(lab, page):
    lab.show(page, NOTEBOOK)


@pytest.mark.parametrize("index", range(len(ORDER)), ids=[kind.__name__ for kind in ORDER])
def test_a_scene_follows_its_slider(page, screenshots, index):
    scene = ExplorerPage(page, index)
    scene.picture.scroll_into_view_if_needed()
    assert scene.shown().startswith(next(iter(ORDER[index].controls.values())).label)
    assert (scene.cut_off(), scene.too_wide()) == ([], [])
    assert scene.box.bounding_box()["height"] <= 680
    handle, readout = scene.slider(0)
    for _ in range(2):
        page.evaluate(_PRESS, [handle.element_handle(), index])
    settle(page)
    label = scene.box.locator(".widget-slider .widget-label").first.inner_text()
    name, unit = re.fullmatch(r"(.*?)(?: \(([^()]*)\))?", label).groups()
    scene.wait_until_shown(f"{name} {float(readout.inner_text()):g} {unit or ''}".strip())
    page.screenshot(path=screenshots / f"lab-{ORDER[index].__name__}.png")
    scene.reset()


def test_a_narrow_window_at_night_shows_all_of_every_scene(page):
    use_theme(page, "Dark")
    use_size(page, 700, 800)
    scenes = [ExplorerPage(page, index) for index in range(len(ORDER))]
    cut = [(scene.cut_off(), scene.too_wide()) for scene in scenes]
    use_size(page, 1280, 800)
    use_theme(page, "Light")
    assert cut == len(ORDER) * [([], [])]


def test_nothing_was_asked_outside_and_no_callback_failed(lab, page):
    assert asked_outside(page, lab.url) == []
    assert raised(page) == []
