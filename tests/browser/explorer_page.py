"""An explorer as a page shows it: its sliders, its picture, and what the picture says of itself."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from lab import settle

# What lies beyond its output, and what would have to be scrolled sideways to see all of it.
_TOO_WIDE = """box => {
    const place = box.closest('.jp-OutputArea-output').getBoundingClientRect();
    const beyond = [...box.querySelectorAll('*')].filter(e => e.getBoundingClientRect().right > place.right + 1);
    const scrolled = [];
    for (let e = box; e; e = e.parentElement)
        if (e.scrollWidth > e.clientWidth + 1 && getComputedStyle(e).overflowX !== 'visible') scrolled.push(e);
    return [...beyond, ...scrolled].map(e => e.className || e.tagName);
}"""

# The picture's own description: the text chunk behind the header of its PNG. Read from what the
# page shows, decoded.
_SHOWN = """async (index) => {
    const image = document.querySelectorAll('.jp-NotebookPanel:not(.lm-mod-hidden) img.losbench-picture')[index];
    await image.decode();
    const bytes = await (await fetch(image.src)).arrayBuffer();
    const length = new DataView(bytes).getUint32(33);
    const chunk = new TextDecoder().decode(bytes.slice(41, 41 + length));
    if (!chunk.startsWith('Description')) throw new Error('the picture says nothing of itself');
    return chunk.split('\\0').at(-1);
}"""


class ExplorerPage:
    """The explorer number ``index`` of the notebook in front, or any other ``box`` of sliders."""

    def __init__(self, page: Any, index: int = 0, *, box: Any = None) -> None:
        self.page, self._index = page, index
        panel = page.locator(".jp-NotebookPanel:not(.lm-mod-hidden)")
        self.picture = panel.locator("img.losbench-picture").nth(index)
        self.picture.wait_for(timeout=60_000)
        self.box = box or panel.locator(".losbench-explorer").nth(index)

    def shown(self) -> str:
        """Return the settings that the picture on the screen was drawn for."""
        for _ in range(20):
            try:
                return str(self.page.evaluate(_SHOWN, self._index))
            except (
                Exception
            ) as problem:  # the picture was replaced between the two steps of reading it
                last = problem
                time.sleep(0.05)
        raise last

    def reset(self) -> None:
        """Go back to the first settings."""
        self.button("reset").click()
        settle(self.page)

    def wait_until_shown(self, text: str | Callable[[], str], *, timeout_s: float = 10.0) -> None:
        """Return when the picture says that it shows ``text``, or what ``text()`` is by then."""
        end = time.monotonic() + timeout_s
        while (asked := text if isinstance(text, str) else text()) not in (
            now := self.shown().split("; ")
        ):
            if time.monotonic() > end:
                raise AssertionError(f"the picture should show {asked!r}, but shows {now}")
            self.page.wait_for_timeout(20)

    def slider(self, number: int) -> tuple[Any, Any]:
        """Return handle and readout of a slider."""
        row = self.box.locator(".widget-slider").nth(number)
        own, beside = row.locator(".widget-readout"), row.locator("xpath=following-sibling::*")
        return row.locator(".noUi-handle"), own if own.is_visible() else beside

    def cut_off(self) -> list[str]:
        """Return the labels and the code that do not fit into their place."""
        parts = self.box.locator(".widget-label, .widget-button, textarea")
        return list(
            parts.evaluate_all(
                "all => all.filter(one => one.scrollWidth > one.clientWidth || one.scrollHeight > "
                "one.clientHeight + 4)"
                ".map(one => one.value || one.innerText)"
            )
        )

    def too_wide(self) -> list[str]:
        """Return the parts that stick out, or that one would have to scroll sideways for."""
        return list(self.box.evaluate(_TOO_WIDE))

    def handle(self, label: str) -> Any:
        """Return a handle over the picture by its label."""
        return self.box.get_by_role("slider", name=label, exact=True)

    def middle(self, label: str) -> tuple[float, float]:
        """Return where a handle is on the page."""
        box = self.handle(label).bounding_box()
        return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def button(self, name: str) -> Any:
        """Return a button by the words on it."""
        return self.box.get_by_role("button", name=name, exact=True)

    def field(self, label: str) -> Any:
        """Return a text field by the beginning of its label."""
        return self.box.locator(".widget-text", has_text=label).locator("input")

    def drag(
        self, number: int, *, across: float = 0.6, steps: int = 60, seconds: float = 1.5
    ) -> None:
        """Drag a slider by mouse over a part of its track, away from the nearer end."""
        handle, _ = self.slider(number)
        handle.scroll_into_view_if_needed()
        box = handle.bounding_box()
        track = self.box.locator(".noUi-target").nth(number).bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        direction = 1 if x < track["x"] + track["width"] / 2 else -1
        self.page.mouse.move(x, y)
        self.page.mouse.down()
        for k in range(1, steps + 1):
            self.page.mouse.move(x + direction * across * track["width"] * k / steps, y)
            self.page.wait_for_timeout(1e3 * seconds / steps)
        self.page.mouse.up()
