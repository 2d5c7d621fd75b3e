"""Ten minutes of random slider moves over all explorers in JupyterLab: no error, and no memory that
keeps growing.

Every explorer stands in one notebook, so that one kernel feeds them all. Its resident memory is
read every few seconds; what it has grown by is the median of the last readings less that of the
first ones after a warm-up.
"""

import argparse
import random
import re
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import nbformat

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "tests" / "browser"))

from explorer_page import ExplorerPage  # noqa: E402
from lab import CHROMIUM, WHY_NOT, ask_kernel, chromium, jupyterlab, notebook, raised  # noqa: E402

from losbench.workbench import explorers  # noqa: E402

LIMIT_MB = 20.0
WARM_UP = 0.15
KEYS = ("ArrowRight", "ArrowLeft", "PageUp", "PageDown", "Home", "End")
RESIDENT_KB = (
    "print(next(line for line in open('/proc/self/status') if line.startswith('VmRSS')).split()[1])"
)


def move(page: Any, explorer: ExplorerPage, rng: random.Random) -> None:
    """Do what a hand would do next: keys, now and then a drag, a button or a wrong seed."""
    number = rng.randrange(explorer.box.locator(".noUi-handle").count())
    dice = rng.random()
    if dice < 0.80:
        explorer.slider(number)[0].focus()
        for _ in range(rng.randint(1, 8)):
            page.keyboard.press(rng.choice(KEYS))
            page.wait_for_timeout(rng.randint(5, 60))
    elif dice < 0.90:
        explorer.drag(number, across=rng.uniform(-0.5, 0.5), steps=25, seconds=0.6)
    elif dice < 0.95:
        explorer.button(rng.choice(["reset", "new noise"])).click()
    else:
        field = explorer.field("seed")
        field.fill(rng.choice(["7", "abc", "", "-3"]))
        field.press("Enter")


def troubles(page: Any, log: list[str]) -> list[str]:
    """What has gone wrong so far: in the page, or under a cell."""
    outputs = page.locator(".jp-NotebookPanel:not(.lm-mod-hidden) .jp-RenderedText")
    return (
        log
        + raised(page)
        + [text for text in outputs.all_inner_texts() if "Traceback" in text or "Warning" in text]
    )


def soak(page: Any, lab: Any, seconds: float, seed: int) -> tuple[int, list[float], list[str]]:
    """Move sliders for so long; return moves, memory readings in MB and troubles."""
    log: list[str] = []
    page.on("pageerror", lambda problem: log.append(str(problem)))
    lab.open(page, "soak.ipynb")
    lab.run_all(page)
    every = [ExplorerPage(page, index) for index in range(len(explorers.__all__))]
    rng, moves, memory = random.Random(seed), 0, []
    start = reading = time.monotonic()
    while (now := time.monotonic()) - start < seconds:
        move(page, rng.choice(every), rng)
        moves += 1
        if now - reading > min(5.0, seconds / 40):
            reading = now
            memory.append(int(re.sub(r"\D", "", ask_kernel(page, RESIDENT_KB))) / 1024)
        if troubles(page, log):
            break
    for explorer in every:
        explorer.button("reset").click()
        page.wait_for_timeout(1000)
        explorer.shown()
    return moves, memory, troubles(page, log)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    if CHROMIUM is None:
        sys.exit(print(WHY_NOT))
    cells = [
        f"from losbench.workbench.explorers import {kind}\n{kind}()" for kind in explorers.__all__
    ]
    with (
        tempfile.TemporaryDirectory() as folder,
        chromium() as browser,
        jupyterlab(Path(folder)) as lab,
    ):
        nbformat.write(notebook(*cells), Path(folder) / "soak.ipynb")
        with browser.new_context(viewport={"width": 1280, "height": 1000}) as context:
            moves, memory, trouble = soak(context.new_page(), lab, options.seconds, options.seed)
    settled = memory[int(WARM_UP * len(memory)) :]
    part = max(1, len(settled) // 5)
    grown = statistics.median(settled[-part:]) - statistics.median(settled[:part])
    print(f"{moves} moves in {options.seconds:g} s, {len(trouble)} errors")
    print(f"kernel {settled[0]:.0f} MB, grown by {grown:+.1f} MB (less than {LIMIT_MB:g})")
    for text in trouble:
        print(text)
    sys.exit(bool(trouble) or grown >= LIMIT_MB)


if __name__ == "__main__":
    main()
