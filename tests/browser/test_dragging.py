"""Pictures that are dragged, on one page in JupyterLab: pointer, keys, touch, both themes, a narrow
window.
"""

import re

import nbformat
import pytest
from explorer_page import ExplorerPage
from lab import ask_kernel, asked_outside, notebook, raised, settle, use_size, use_theme

pytestmark = pytest.mark.browser

KINDS = ("DragPoint", "YourLayout", "CentroidExplorer", "ChainExplorer")
_IMPORT = (
    "from losbench.workbench.explorers import *\nfrom losbench.workbench.explorers.lab import *"
)
_COUNT = "import ipywidgets.widgets.widget as w; print(len(w._instances))"
_FIND = (
    "from ipywidgets.widgets.widget import _instances; "
    "explorer = next(w for w in _instances.values() if hasattr(w, 'ask'))"
)
# The middle of the picture's first pixels: paper, whatever is drawn.
_CORNER = """async (index) => {
    const image = document.querySelectorAll('img.losbench-picture')[index];
    await image.decode();
    const canvas = new OffscreenCanvas(image.naturalWidth, image.naturalHeight);
    const context = canvas.getContext('2d');
    context.drawImage(image, 0, 0);
    return [...context.getImageData(2, 2, 1, 1).data].slice(0, 3);
}"""


@pytest.fixture(autouse=True)
def shown(lab, page):
    cells = notebook(_IMPORT, *(f"{kind}()" for kind in KINDS))
    nbformat.write(cells, lab.root / "dragging.ipynb")
    lab.show(page, "dragging.ipynb")


def opened(page, kind):
    explorer = ExplorerPage(page, KINDS.index(kind))
    explorer.reset()
    explorer.picture.scroll_into_view_if_needed()
    return explorer


def by_pointer(page, explorer, label, right, down):
    x, y = explorer.middle(label)
    page.mouse.move(x, y)
    page.mouse.down()
    for k in range(1, 21):
        page.mouse.move(x + right * k / 20, y + down * k / 20)
        page.wait_for_timeout(15)
    page.mouse.up()


def by_touch(page, explorer, label, right, down):
    x, y = explorer.middle(label)
    touch = page.context.new_cdp_session(page)
    touch.send(
        "Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [{"x": x, "y": y}]}
    )
    for k in range(1, 11):
        at = {"x": x + right * k / 10, "y": y + down * k / 10}
        touch.send("Input.dispatchTouchEvent", {"type": "touchMove", "touchPoints": [at]})
        page.wait_for_timeout(20)
    touch.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})


def said(page, explorer, label, before):
    """Return the words of a handle once all is answered; they must be others than before."""
    settle(page)
    now = explorer.handle(label).get_attribute("aria-valuetext")
    assert now != before
    return now


@pytest.mark.parametrize("way", [by_pointer, by_touch], ids=["pointer", "touch"])
def test_the_picture_states_where_the_hand_has_put_the_point(page, way):
    scene = opened(page, "DragPoint")
    way(page, scene, "the big point", 80, 100)
    # 840 px wide: 16.7 px are 1 along x, 5.5 px 1 along y, to half a unit.
    words = said(page, scene, "the big point", "x 9, y 16")
    x, y = map(float, re.fullmatch(r"x (\d+\.?\d*), y (-?\d+\.?\d*)", words).groups())
    assert 9.0 + 80 / 17.5 - 0.8 < x < 9.0 + 80 / 15.5 + 0.8
    assert 16.0 - 100 / 5.0 - 0.8 < y < 16.0 - 100 / 6.5 + 0.8
    scene.wait_until_shown(f"its place along x {x:g}")
    scene.wait_until_shown(f"height of the point {y:g}")
    assert scene.picture.get_attribute("alt") == scene.shown()
    assert scene.slider(0)[1].inner_text().replace("−", "-") == f"{y:.1f}"


def test_arrow_keys_step_and_shift_steps_by_ten(page):
    scene = opened(page, "DragPoint")
    scene.handle("the big point").focus()
    for key in ("ArrowRight", "ArrowRight", "ArrowDown", "Shift+ArrowUp"):
        page.keyboard.press(key)
    scene.wait_until_shown("its place along x 10")
    scene.wait_until_shown("height of the point 20.5")


def test_every_spot_of_a_layout_and_the_window_of_a_spot_can_be_dragged(page):
    layout = opened(page, "YourLayout")
    by_pointer(page, layout, "spot 3", 60, -20)
    place = said(page, layout, "spot 3", "x 0.0, y 1.0")
    u, v = re.fullmatch(r"x (-?[\d.]+), y (-?[\d.]+)", place).groups()
    assert (float(u), float(v)) > (0.5, 1.0)
    layout.wait_until_shown(lambda: f"moved (spot u v, …) 3 {float(u):g} {float(v):g}")
    spot = opened(page, "CentroidExplorer")
    by_pointer(page, spot, "edge of the window", 10, 0)
    window = said(page, spot, "edge of the window", "window 19 px")
    assert 21 <= int(window.split()[1]) <= 33
    spot.wait_until_shown(window)


def test_the_chain_follows_the_hand_and_settles_when_it_rests(page, screenshots):
    chain = opened(page, "ChainExplorer")
    before = chain.handle("spot 2").get_attribute("aria-valuetext")
    by_pointer(page, chain, "spot 2", -60, 30)
    counted = chain.box.locator("div", has_text=re.compile(r"^bad spots survived")).last
    place = said(page, chain, "spot 2", before)
    x, y = re.fullmatch(r"x (-?\d+), y (-?\d+)", place).groups()
    chain.wait_until_shown(f"moved (spot x y, …) 2 {x} {y}")
    assert re.search(r"\d of 8", counted.inner_text())
    assert chain.box.bounding_box()["height"] <= 680
    page.screenshot(path=screenshots / "chain.png")


def test_what_is_typed_out_of_range_is_said_and_changes_nothing(page):
    scene = opened(page, "DragPoint")
    first, (_, readout) = scene.shown(), scene.slider(0)
    for text, said in (("35", "25 is the most, got 35"), ("-99", "-25 is the least, got -99")):
        readout.fill(text)
        readout.press("Enter")
        scene.box.get_by_role("alert").filter(has_text=said).wait_for(timeout=5_000)
        assert readout.inner_text() == "16.0"
        assert scene.shown() == first
    readout.fill("12")
    readout.press("Enter")
    scene.wait_until_shown("height of the point 12")
    assert scene.box.get_by_role("alert").filter(has_text="Note").count() == 0


def test_the_code_is_copied_or_shown(page):
    scene = opened(page, "DragPoint")
    scene.button("copy as code").click()
    scene.box.get_by_role("status").filter(has_text=re.compile("copied|Ctrl")).wait_for(
        timeout=5_000
    )


def test_the_picture_follows_the_theme_and_a_narrow_window(page, screenshots):
    scene = opened(page, "DragPoint")
    assert page.evaluate(_CORNER, 0) == [255, 255, 255]
    use_theme(page, "Dark")
    assert max(page.evaluate(_CORNER, 0)) < 40
    page.screenshot(path=screenshots / "dragging-dark.png")
    use_size(page, 700, 800)
    page.screenshot(path=screenshots / "dragging-narrow.png")
    inner = scene.picture.bounding_box()
    assert inner["width"] > 200
    assert scene.too_wide() == []
    assert scene.picture.evaluate("image => image.naturalWidth") == pytest.approx(
        inner["width"], abs=2
    )
    scene.handle("the big point").focus()
    page.keyboard.press("ArrowRight")
    scene.wait_until_shown("its place along x 9.5")
    use_size(page, 1280, 800)
    use_theme(page, "Light")


def test_what_a_callback_raises_would_be_noticed(page):
    """The check that other tests rest on: such errors reach the log, but no cell."""
    scene = opened(page, "DragPoint")
    assert raised(page) == []
    ask_kernel(page, f"{_FIND}; explorer.update = lambda **_: 1 / 0")
    scene.button("new noise").click()
    page.wait_for_function("() => window.raised.length > 0", timeout=5_000)
    assert raised(page) == ["ZeroDivisionError: division by zero"]
    ask_kernel(page, f"{_FIND}; del explorer.update")
    page.evaluate("() => { window.raised.length = 0; }")


def test_running_the_cells_again_leaves_no_live_widgets_behind(lab, page):
    counts = []
    for _ in range(3):
        lab.run_all(page)
        ExplorerPage(page).shown()
        counts.append(ask_kernel(page, _COUNT))
    assert counts == 3 * [counts[0]]


def test_nothing_was_asked_outside_and_no_callback_failed(lab, page):
    assert asked_outside(page, lab.url) == []
    assert raised(page) == []
