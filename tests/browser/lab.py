"""JupyterLab in a headless Chromium: a server with settings of its own, notebooks that run, sliders
that move.

Used by the browser tests, by the latency benchmark and by the soak test.
"""

from __future__ import annotations

import json
import os
import secrets
import shutil
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import nbformat

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
WHY_NOT = "chromium is missing: apt-get install chromium (environment.md, browser tests)"

_FLAGS = [
    *("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
]
_NO_NEWS = {"fetchNews": "false", "checkForUpdates": False}

_READY = """async () => {
    const app = window.jupyterapp;
    await app.started;
    await app.restored;
    const panel = app.shell.currentWidget;
    await panel.context.ready;
    await panel.revealed;
    await panel.sessionContext.ready;
    await panel.sessionContext.session.kernel.info;
}"""
_IN_FRONT = "() => window.jupyterapp?.shell.currentWidget?.context?.path"
# Within JupyterLab as it stands: to load it anew takes four times as long.
_OPEN = """async (path) => {
    const panel = await window.jupyterapp.commands.execute('docmanager:open', {path});
    await panel.revealed;
}"""
_CLOSE = """async () => {
    const panel = window.jupyterapp.shell.currentWidget;
    await panel.sessionContext.shutdown();
    panel.context.model.dirty = false;
    panel.dispose();
}"""
# The promise of a run is not returned: it would wait for widgets that are still being drawn.
_RUN_ALL = """() => {
    const {sharedModel} = window.jupyterapp.shell.currentWidget.content.model;
    window.code = () => sharedModel.cells.filter(cell => cell.cell_type === 'code' && cell.source.trim());
    window.before = window.code().map(cell => cell.execution_count);
    window.jupyterapp.commands.execute('notebook:run-all-cells');
}"""
# One after the other, since a run that fails would cancel those that wait.
_RUN_SOME = """async (holding) => {
    const panel = window.jupyterapp.shell.currentWidget.content;
    const code = panel.widgets.filter(cell => cell.model.type === 'code');
    for (const cell of code.filter((cell, k) => !k || cell.model.sharedModel.source.includes(holding))) {
        const before = cell.model.executionCount;
        panel.activeCellIndex = panel.widgets.indexOf(cell);
        window.jupyterapp.commands.execute('notebook:run-cell');
        while ([null, before].includes(cell.model.executionCount)) await new Promise(requestAnimationFrame);
    }
    return code.flatMap(cell => cell.model.sharedModel.outputs)
        .filter(output => output.output_type === 'error').map(error => `${error.ename}: ${error.evalue}`);
}"""
_STATE = """() => {
    const code = window.code();
    const errors = code.flatMap(cell => cell.outputs.filter(output => output.output_type === 'error'));
    const panel = document.querySelector('.jp-NotebookPanel:not(.lm-mod-hidden)');
    const prompts = [...panel.querySelectorAll('.jp-CodeCell .jp-InputPrompt')];
    return {
        pending: code.filter((cell, k) => [null, window.before[k]].includes(cell.execution_count)).length
            + prompts.filter(prompt => prompt.textContent.includes('*')).length,
        errors: errors.map(error => `${error.ename}: ${error.evalue}`),
    };
}"""


_ASK = """async (code) => {
    const kernel = window.jupyterapp.shell.currentWidget.sessionContext.session.kernel;
    const future = kernel.requestExecute({code, store_history: false});
    let text = '';
    future.onIOPub = message => { if (message.header.msg_type === 'stream') text += message.content.text; };
    await future.done;
    return text;
}"""


# What a callback raises reaches no cell, only the log.
_WATCH = """() => {
    window.raised = [];
    const kernel = window.jupyterapp.shell.currentWidget.sessionContext.session.kernel;
    kernel.anyMessage.connect((_, {msg}) => {
        if (msg.header.msg_type === 'error') window.raised.push(`${msg.content.ename}: ${msg.content.evalue}`);
    });
}"""
_THEME = "theme => { window.jupyterapp.commands.execute('apputils:change-theme', {theme}); }"
# The kernel answers widgets in turn, in a subshell of their own if it has one, and a page keeps what
# it asks next until then: what a hand has done may take one question under way, one that waits, and
# one for what was left out while it moved.
_SETTLE = """async () => {
    const kernel = window.jupyterapp.shell.currentWidget.sessionContext.session.kernel;
    const listed = kernel.supportsSubshells ? await kernel.requestListSubshell({}).done : null;
    for (let turn = 0; turn < 3; turn++)
        for (const shell of [null, ...listed?.content.subshell_id ?? []]) {
            kernel.subshellId = shell;
            const asked = kernel.requestExecute({code: '', silent: true, store_history: false});
            kernel.subshellId = null;
            await asked.done;
        }
}"""


def settle(page: Any) -> None:
    """Return when the kernel has answered all that the page has asked, and the page knows."""
    page.evaluate(_SETTLE)


def use_theme(page: Any, name: str) -> None:
    """Turn JupyterLab "Light" or "Dark", and wait until the pictures are."""
    page.evaluate(_THEME, f"JupyterLab {name}")
    page.wait_for_function(
        f"() => document.body.dataset.jpThemeLight === '{str(name == 'Light').lower()}'"
    )
    settle(page)


def use_size(page: Any, width: int, height: int) -> None:
    """Give the window another size, and wait until the pictures fit it."""
    page.set_viewport_size({"width": width, "height": height})
    page.evaluate(
        "() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"
    )
    settle(page)


def ask_kernel(page: Any, code: str) -> str:
    """Run code in the kernel of the notebook in front, outside of any cell; return what it
    prints.
    """
    return str(page.evaluate(_ASK, code))


def asked_outside(page: Any, url: str) -> list[str]:
    """Return what the page has asked for elsewhere than there, and its own errors."""
    return [each for each in page.asked if not each.startswith((url, "blob:", "data:"))]


def raised(page: Any) -> list[str]:
    """Return the errors of the kernel since the notebook was opened, those of callbacks
    included.
    """
    return list(page.evaluate("() => window.raised"))


def notebook(*sources: str) -> nbformat.NotebookNode:
    """Make a notebook of code cells."""
    cells = [nbformat.v4.new_code_cell(source, id=f"cell-{k}") for k, source in enumerate(sources)]
    kernel = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
    return nbformat.v4.new_notebook(cells=cells, metadata=kernel)


@contextmanager
def chromium() -> Iterator[Any]:
    """Give a browser with a fresh profile."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, headless=True, args=_FLAGS)
        try:
            yield browser
        finally:
            browser.close()


@contextmanager
def jupyterlab(root: Path) -> Iterator[Lab]:
    """Serve a folder of notebooks, with none of the user's settings."""
    with tempfile.TemporaryDirectory(prefix="losbench-lab-", ignore_cleanup_errors=True) as folder:
        home = Path(folder)
        settings = home / "settings/@jupyterlab/apputils-extension"
        settings.mkdir(parents=True)
        (settings / "notification.jupyterlab-settings").write_text(
            json.dumps(_NO_NEWS), encoding="utf-8"
        )
        own = {
            "HOME": "home",
            "JUPYTER_CONFIG_DIR": "config",
            "JUPYTER_DATA_DIR": "data",
            "IPYTHONDIR": "ipython",
        }
        own |= {"JUPYTERLAB_SETTINGS_DIR": "settings", "JUPYTERLAB_WORKSPACES_DIR": "workspaces"}
        environment = {**os.environ, **{name: str(home / part) for name, part in own.items()}}
        environment |= {
            "JUPYTER_RUNTIME_DIR": str(home / "run"),
            "LOSBENCH_BUILD": str(home / "build"),
        }
        lab = Lab(root, port=_free_port(), token=secrets.token_hex(16))
        with (home / "log").open("w", encoding="utf-8") as log:
            server = subprocess.Popen(
                lab.command, env=environment, stdout=log, stderr=subprocess.STDOUT
            )
        try:
            lab.wait(server, home / "log")
            yield lab
        finally:
            with suppress(OSError):
                lab.delete_sessions()
            server.terminate()
            server.wait(timeout=20)


class Lab:
    """A running server; `open` gives a notebook in a page."""

    def __init__(self, root: Path, *, port: int, token: str) -> None:
        self.root, self.url = root, f"http://127.0.0.1:{port}"
        self._token = token
        self.command = [
            *(
                sys.executable,
                "-m",
                "jupyterlab",
                "--no-browser",
                "--allow-root",
                "--expose-app-in-browser",
            ),
            *("--ip=127.0.0.1", f"--port={port}", "--ServerApp.port_retries=0"),
            *(f"--IdentityProvider.token={token}", f"--ServerApp.root_dir={root}"),
        ]

    def wait(self, server: subprocess.Popen[bytes], log: Path) -> None:
        """Return when the server answers."""
        for _ in range(300):
            if server.poll() is not None:
                raise RuntimeError(f"jupyter lab ended:\n{log.read_text(encoding='utf-8')}")
            with suppress(OSError):
                self._ask("GET", "/api/status")
                return
            time.sleep(0.2)
        raise TimeoutError("jupyter lab did not answer within a minute")

    def delete_sessions(self) -> None:
        """End all kernels."""
        for session in json.loads(self._ask("GET", "/api/sessions")):
            self._ask("DELETE", f"/api/sessions/{session['id']}")

    def open(self, page: Any, name: str) -> None:
        """Open a notebook and wait until its kernel is ready."""
        page.goto(f"{self.url}/lab/tree/{name}?token={self._token}&reset")
        page.wait_for_selector(".jp-NotebookPanel:not(.lm-mod-hidden) .jp-CodeCell", timeout=60_000)
        page.evaluate(_READY)
        page.evaluate(_WATCH)

    def show(self, page: Any, name: str, *, holding: str = "") -> None:
        """Bring a notebook to the front, as it is if it is there, else in place of the one that is,
        and run its first cell and those that hold a text, by default all.
        """
        there = page.evaluate(_IN_FRONT)
        if there == name:
            return
        if there is None:
            self.open(page, name)
        else:
            page.evaluate(_CLOSE)
            page.evaluate(_OPEN, name)
            page.evaluate(_READY)
            page.evaluate(_WATCH)
        self.run_some(page, holding) if holding else self.run_all(page)

    def run_all(self, page: Any, *, timeout_s: float = 400.0) -> None:
        """Run every cell of the notebook in front; raise if one of them fails."""
        page.evaluate(_RUN_ALL)
        end = time.monotonic() + timeout_s
        while (state := page.evaluate(_STATE))["pending"] and not state["errors"]:
            if time.monotonic() > end:
                raise TimeoutError(f"{state['pending']} cells still run after {timeout_s:g} s")
            page.wait_for_timeout(100)
        if state["errors"]:
            raise AssertionError("; ".join(state["errors"]))

    def run_some(self, page: Any, holding: str) -> None:
        """Run the first cell of the notebook in front and those that hold a text."""
        if errors := page.evaluate(_RUN_SOME, holding):
            raise AssertionError("; ".join(errors))

    def _ask(self, method: str, path: str) -> str:
        request = urllib.request.Request(
            f"{self.url}{path}", method=method, headers={"Authorization": f"token {self._token}"}
        )
        with urllib.request.urlopen(request, timeout=5) as answer:
            return answer.read().decode("utf-8")


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
