"""A page in a headless Chromium, driven by the DevTools protocol over two pipes: no package needed.

Tests are skipped where no `chromium` is on the PATH.
"""

import json
import os
import shutil
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import pytest

OPTIONS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--window-size=1200,900",
)
KEYS = {"Escape": 27, "ArrowLeft": 37, "ArrowRight": 39}
"""Keys of the keyboard and their codes."""
PATIENCE_S = 120
"""A browser that is open for longer hangs, and is ended."""


class BrowserPage:
    """One open page: scripts are evaluated in it, keys pressed, and its history is gone through."""

    def __init__(self, requests: BinaryIO, answers: BinaryIO) -> None:
        self.requests, self.answers, self.count, self.session = requests, answers, 0, ""
        self.events: list[str] = []

    def send(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a command of the protocol, and wait for its answer."""
        self.count += 1
        message = {"id": self.count, "method": method, "params": parameters}
        message |= {"sessionId": self.session} if self.session else {}
        self.requests.write(json.dumps(message).encode() + b"\0")
        self.requests.flush()
        while (answer := self._message()).get("id") != self.count:
            self.events.append(answer.get("method", ""))
        assert "error" not in answer, (method, answer["error"])
        return dict(answer["result"])

    def _message(self) -> dict[str, Any]:
        message = bytearray()
        while (byte := self.answers.read(1)) != b"\0":
            assert byte, "the browser has ended"
            message += byte
        return dict(json.loads(message))

    def open(self, address: str) -> None:
        """Open an address in a new page, and wait until it is loaded."""
        target = self.send("Target.createTarget", url="about:blank")["targetId"]
        attached = self.send("Target.attachToTarget", targetId=target, flatten=True)
        self.session = attached["sessionId"]
        self.send("Page.enable")
        self.events.clear()
        self.send("Page.navigate", url=address)
        while "Page.loadEventFired" not in self.events:
            self.events.append(self._message().get("method", ""))

    def evaluate(self, script: str) -> Any:
        """The value of an expression, of a promise once it is kept; an error fails the test."""
        answer = self.send(
            "Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True
        )
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def settle(self) -> None:
        """Wait until the page has drawn itself twice: events that wait for that are over then."""
        self.evaluate("new Promise(d => requestAnimationFrame(() => requestAnimationFrame(d)))")

    def press(self, key: str) -> None:
        """Press a key, as somebody at the keyboard does."""
        for kind in ("rawKeyDown", "keyUp"):
            self.send(
                "Input.dispatchKeyEvent",
                type=kind,
                key=key,
                code=key,
                windowsVirtualKeyCode=KEYS[key],
            )
        self.settle()

    def go(self, steps: int) -> None:
        """Go through the history, as the back button (-1) does; within the page."""
        self.evaluate(
            "new Promise(done => { addEventListener('popstate', () => setTimeout(done),"
            f" {{once: true}}); history.go({steps}); }})"
        )
        self.settle()


@contextmanager
def browser_page(address: str, profile: Path) -> Iterator[BrowserPage]:
    """Open an address in Chromium, which is ended afterwards; skips the test without one.

    Args:
        address: of the page.
        profile: a new folder for the browser's own files.

    """
    program = shutil.which("chromium")
    if program is None:
        pytest.skip("no `chromium` on the PATH: the pages' scripts are tried in it")
    to_browser, requests = os.pipe()
    answers, from_browser = os.pipe()
    redirected = f'exec "$@" 3<&{to_browser} 4>&{from_browser} 2>/dev/null'
    command = (program, *OPTIONS, f"--user-data-dir={profile}", "--remote-debugging-pipe")
    process = subprocess.Popen(
        ["bash", "-c", redirected, "bash", *command], pass_fds=(to_browser, from_browser)
    )
    os.close(to_browser)
    os.close(from_browser)
    patience = threading.Timer(PATIENCE_S, process.kill)  # whoever waits for an answer fails then
    patience.start()
    with os.fdopen(requests, "wb") as writer, os.fdopen(answers, "rb") as reader:
        page = BrowserPage(writer, reader)
        try:
            page.open(address)
            yield page
            page.session = ""
            page.send("Browser.close")
        finally:
            patience.cancel()
            process.terminate()
            process.wait(timeout=60)
