"""A headless Chromium, driven through its DevTools pipe; no library needed."""

import base64
import contextlib
import json
import os
import select
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--disable-dev-shm-usage", "--hide-scrollbars", "--remote-debugging-pipe",
)  # fmt: skip
COMPLAINTS = (
    "Runtime.consoleAPICalled", "Runtime.exceptionThrown", "Log.entryAdded", "Network.loadingFailed",
)  # fmt: skip


def chromium() -> str | None:
    """Return the browser's path, if there is one."""
    return next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


class Page:
    """One tab."""

    def __init__(self, write: int, read: int) -> None:
        self._write, self._read = write, read
        self._buffer, self._next = b"", 0
        self._session: dict[str, str] = {}
        self.events: list[dict[str, Any]] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        self._session = {"sessionId": session}
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **params: Any) -> dict[str, Any]:
        """Call a DevTools method and return its result."""
        self._next += 1
        message = {"id": self._next, "method": method, "params": params} | self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while (answer := self._receive()).get("id") != self._next:
            self.events.append(answer)
        assert "error" not in answer, answer
        return answer["result"]

    def _receive(self) -> dict[str, Any]:
        while b"\0" not in self._buffer:
            ready, _, _ = select.select([self._read], [], [], 60)
            assert ready, "the browser does not answer"
            data = os.read(self._read, 1 << 20)
            assert data, "the browser is gone"
            self._buffer += data
        first, _, self._buffer = self._buffer.partition(b"\0")
        return json.loads(first)

    def open(self, path: Path, width: int, height: int, *, dark: bool = False, media: str = "") -> None:
        """Open a page at a width, wait until it is there, and add the functions of ``checks.js``."""
        self.events.clear()
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600}
        self.call("Emulation.setDeviceMetricsOverride", **size)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", media=media, features=[scheme])
        self.call("Page.navigate", url=path.as_uri())
        while not any(e.get("method") == "Page.loadEventFired" for e in self.events):
            self.events.append(self._receive())
        self.evaluate((Path(__file__).parent / "checks.js").read_text(encoding="utf-8"))

    def evaluate(self, expression: str) -> Any:
        """Return the value of a JavaScript expression."""
        result = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in result, result
        return result["result"].get("value")

    def save(self, path: Path, method: str, **params: Any) -> Path:
        """Write what a method returns, a picture or a print, into a file."""
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(base64.b64decode(self.call(method, **params)["data"]))
        return path

    def complaints(self) -> list[str]:
        """Return what the page wrote to the console, and every request that left it or failed."""
        known = [(e.get("method"), e.get("params", {})) for e in self.events]
        urls = [p["request"]["url"] for method, p in known if method == "Network.requestWillBeSent"]
        found = [f"{method}: {params}" for method, params in known if method in COMPLAINTS]
        return [*found, *(f"request: {url}" for url in urls if not url.startswith(("file:", "data:")))]


@contextlib.contextmanager
def browser(profile: Path) -> Iterator[Page]:
    """Start Chromium with an empty profile of its own, and end it afterwards."""
    path = chromium()
    assert path is not None
    (command_read, command_write), (answer_read, answer_write) = os.pipe(), os.pipe()

    def connect() -> None:
        # The browser reads commands on descriptor 3 and answers on 4.
        a, b = os.dup(command_read), os.dup(answer_write)
        while min(a, b) < 5:
            a, b = os.dup(a), os.dup(b)
        os.dup2(a, 3)
        os.dup2(b, 4)

    quiet = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)
    process = subprocess.Popen(
        [path, *FLAGS, f"--user-data-dir={profile}"], pass_fds=(3, 4), **quiet,
        preexec_fn=connect,  # noqa: PLW1509, nothing else runs yet
    )  # fmt: skip
    for end in (command_read, answer_write):
        os.close(end)
    try:
        yield Page(command_write, answer_read)
    finally:
        process.kill()  # its profile is of this test alone
        process.wait(10)
        for end in (command_write, answer_read):
            os.close(end)
