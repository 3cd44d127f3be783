"""A headless Chromium, controlled over its DevTools pipe, so that the tests need no package and no
port."""

import base64
import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

CHROMIUM = (
    shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
)
OPTIONS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--remote-debugging-pipe",
    "--no-first-run",
    "--hide-scrollbars",
)


class Browser:
    """A headless browser with one page. complaints: texts of the page's console and of its uncaught
    errors."""

    def __init__(self, profile: Path) -> None:
        assert CHROMIUM is not None
        (theirs, self._out), (back, theirs_out) = os.pipe(), os.pipe()
        command = [CHROMIUM, *OPTIONS, f"--user-data-dir={profile}", "about:blank"]
        self._process = subprocess.Popen(
            ["bash", "-c", f'exec "$@" 3<&{theirs} 4>&{theirs_out}', "bash", *command],
            pass_fds=(theirs, theirs_out), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        os.close(theirs)
        os.close(theirs_out)
        self._in = os.fdopen(back, "rb")
        self._tail = b""
        self._number = 0
        self._session = None
        self.complaints: list[str] = []
        targets = self._ask("Target.getTargets")["targetInfos"]
        target = next(t["targetId"] for t in targets if t["type"] == "page")
        self._session = self._ask("Target.attachToTarget", targetId=target, flatten=True)[
            "sessionId"
        ]
        for domain in ("Page", "Runtime", "Log"):
            self._ask(f"{domain}.enable")

    def open(self, url: str, *, width: int = 1100, height: int = 1500, dark: bool = False) -> None:
        """Go to a page and wait until it has loaded."""
        self._ask(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self._ask("Emulation.setEmulatedMedia", features=[scheme])
        self._ask("Page.navigate", url=url)
        while self._read().get("method") != "Page.loadEventFired":
            pass

    def value(self, expression: str) -> Any:
        """Return the value of a JavaScript expression (also a promise) in the page."""
        answer = self._ask(
            "Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True
        )
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def until(self, condition: str) -> None:
        """Wait until a JavaScript condition is true in the page, for a minute at most."""
        look = (
            f"if ({condition}) yes(true); else if (performance.now() > end) yes(false); else"
            " setTimeout(look, 50)"
        )
        asked = (
            f"new Promise(yes => {{ const end = performance.now() + 60000, look = () => {{ {look};"
            " }; look(); })"
        )
        said = "" if self.value(asked) else self.value("document.body.innerText")
        assert not said, f"condition stays false: {condition}; messages of the page: {said}"

    def mouse(self, what: str, x: float, y: float) -> None:
        """Send a mousePressed, mouseMoved or mouseReleased at a position in the window."""
        button = {} if what == "mouseMoved" else {"button": "left", "clickCount": 1}
        self._ask("Input.dispatchMouseEvent", type=what, x=x, y=y, **button)

    def picture(self, path: Path) -> None:
        """Return a PNG of the page."""
        path.write_bytes(base64.b64decode(self._ask("Page.captureScreenshot")["data"]))

    def close(self) -> None:
        """End the browser."""
        self._process.terminate()
        self._process.wait()
        os.close(self._out)
        self._in.close()

    def _ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if self._session is not None:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._read()
            if answer.get("id") == self._number:
                assert "error" not in answer, answer
                return dict(answer["result"])

    def _read(self) -> dict[str, Any]:
        while b"\0" not in self._tail:
            data = os.read(self._in.fileno(), 1 << 16)
            assert data, "the browser process has ended"
            self._tail += data
        line, _, self._tail = self._tail.partition(b"\0")
        message: dict[str, Any] = json.loads(line)
        said = message.get("params", {})
        if message.get("method") in (
            "Runtime.exceptionThrown",
            "Runtime.consoleAPICalled",
            "Log.entryAdded",
        ):
            self.complaints.append(
                json.dumps(said.get("entry") or said.get("exceptionDetails") or said)
            )
        return message
