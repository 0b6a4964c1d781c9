"""Pages in a headless Chromium, over its DevTools protocol: what they measure, what they complain of, how they look.

    python -m tests.report.browser PAGE.html ... --out FOLDER

writes a picture of every page at every width, light and dark.

The protocol: https://chromedevtools.github.io/devtools-protocol.
"""

from __future__ import annotations

import argparse
import asyncio
import base64
import itertools
import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tornado.websocket import WebSocketClientConnection, websocket_connect

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)
WIDTHS, SCHEMES = (400, 800, 1600), ("light", "dark")
#: A phone held upright, a window on half a screen, a whole screen are all about so high, in pixels.
_HEIGHT = 900
_FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--hide-scrollbars", "--remote-debugging-port=0",
)  # fmt: skip
#: Seconds in which a browser begins and a page is laid out on a busy machine.
_PATIENCE = 120.0

#: What stands out of the window to the right or left, or out of its own box, where nothing scrolls.
_MEASURE = """
(() => {
  const wide = document.documentElement.scrollWidth, seen = document.documentElement.clientWidth, out = [];
  const scrolls = (e) => { for (let p = e.parentElement; p; p = p.parentElement)
    if (["auto", "scroll"].includes(getComputedStyle(p).overflowX)) return true; return false; };
  for (const e of document.body.querySelectorAll("*")) {
    if (e.closest("svg") && e.tagName !== "svg") continue;
    const box = e.getBoundingClientRect();
    if (!box.width || scrolls(e)) continue;
    const over = !["auto", "scroll"].includes(getComputedStyle(e).overflowX) && e.clientWidth
      && getComputedStyle(e).display !== "inline" && e.scrollWidth > e.clientWidth + 1;
    if (box.right > seen + 1 || box.left < -1 || over)
      out.push(e.tagName.toLowerCase() + "." + e.className + ": " + e.textContent.trim().slice(0, 60));
  }
  return {page: wide, window: seen, outside: out};
})()
"""
#: Text that hardly stands out of its ground: a ratio of luminances below 4.5, or 3 for large letters
#: (https://www.w3.org/TR/WCAG21/#contrast-minimum).
_FAINT = """
(() => {
  const faint = [];
  const lightness = (c) => { const [r, g, b] = c.match(/[\\d.]+/g).map(Number).map((v) => v / 255)
    .map((v) => v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
    return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
  const ground = (e) => { for (let p = e; p; p = p.parentElement) { const c = getComputedStyle(p).backgroundColor;
    if (!/, 0\\)$/.test(c)) return c; } return "rgb(255, 255, 255)"; };
  for (const e of document.body.querySelectorAll("*")) {
    if (e.closest("svg") || ![...e.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim())) continue;
    const [a, b] = [lightness(getComputedStyle(e).color), lightness(ground(e))];
    const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05), style = getComputedStyle(e);
    const size = parseFloat(style.fontSize), large = size >= 24 || (size >= 18.66 && parseInt(style.fontWeight) >= 600);
    if (ratio < (large ? 3 : 4.5)) faint.push(ratio.toFixed(1) + " " + e.className + ": " + e.textContent.trim());
  }
  return faint;
})()
"""
#: Widths of the pictures, zero where one is broken; those that are scrolled may be wider than the window.
_PICTURES = """
[...document.images].filter((one) => !one.closest(".wide")).map((one) => one.naturalWidth && Math.round(one.width))
"""


#: Tables of which a part is hidden until they are scrolled.
_SCROLLED = """
[...document.querySelectorAll(".scroll")].filter((one) => one.scrollWidth > one.clientWidth + 1)
  .map((one) => one.textContent.trim().replace(/\\s+/g, " ").slice(0, 60))
"""


@dataclass(frozen=True)
class Seen:
    """A page at one width in one scheme of colours: its own width, what overflows, is faint, was complained of.

    ``scrolled`` holds the first words of tables that are wider than their place.
    """

    width: int
    scheme: str
    page: int
    outside: tuple[str, ...]
    faint: tuple[str, ...]
    complaints: tuple[str, ...]
    pictures: tuple[int, ...]
    scrolled: tuple[str, ...]
    png: bytes


def look(
    page: Path, widths: Iterable[int] = WIDTHS, schemes: Iterable[str] = SCHEMES, pictures: bool = False
) -> list[Seen]:
    """A page at each width and in each scheme."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        command = [str(CHROMIUM), *_FLAGS, f"--user-data-dir={profile}", "about:blank"]
        browser = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            return asyncio.run(_look(Path(profile), page, list(itertools.product(widths, schemes)), pictures))
        finally:
            browser.kill()
            browser.wait()


class _Session:
    """Commands to one page and its events, over a web socket."""

    def __init__(self, socket: WebSocketClientConnection) -> None:
        self._socket, self._count, self.session, self.events = socket, 0, "", []  # type: ignore[var-annotated]

    async def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters}
        await self._socket.write_message(json.dumps(message | ({"sessionId": self.session} if self.session else {})))
        while True:
            answer = await self._next()
            if answer.get("id") == self._count:
                assert "error" not in answer, (method, answer)
                return dict(answer["result"])

    async def wait(self, event: str) -> None:
        while not any(one["method"] == event for one in self.events):
            await self._next()

    async def evaluate(self, expression: str) -> Any:
        answer = await self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    async def _next(self) -> dict[str, Any]:
        message = await asyncio.wait_for(self._socket.read_message(), _PATIENCE)
        assert message is not None, "the browser has ended"
        answer: dict[str, Any] = json.loads(message)
        if "method" in answer:
            self.events.append(answer)
        return answer


async def _look(profile: Path, page: Path, cases: list[tuple[int, str]], pictures: bool) -> list[Seen]:
    socket = await websocket_connect(await _address(profile), max_message_size=1 << 30)
    session = _Session(socket)
    target = (await session.call("Target.createTarget", url="about:blank"))["targetId"]
    attached = await session.call("Target.attachToTarget", targetId=target, flatten=True)
    session.session = attached["sessionId"]
    for domain in ("Page", "Runtime", "Log", "Network"):
        await session.call(f"{domain}.enable")
    found = [await _seen(session, page, width, scheme, pictures) for width, scheme in cases]
    session.session = ""
    await session.call("Browser.close")
    while await socket.read_message() is not None:
        pass
    socket.close()
    return found


async def _address(profile: Path) -> str:
    """Where the browser listens, which it writes into its profile."""
    port = profile / "DevToolsActivePort"
    for _ in range(int(10 * _PATIENCE)):
        if port.is_file() and len(lines := port.read_text().splitlines()) == 2:
            return f"ws://127.0.0.1:{lines[0]}{lines[1]}"
        await asyncio.sleep(0.1)
    raise TimeoutError("the browser does not listen")


async def _seen(session: _Session, page: Path, width: int, scheme: str, pictures: bool) -> Seen:
    session.events.clear()
    await session.call(
        "Emulation.setDeviceMetricsOverride", width=width, height=_HEIGHT, deviceScaleFactor=1, mobile=False
    )
    await session.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
    await session.call("Page.navigate", url=page.resolve().as_uri())
    await session.wait("Page.loadEventFired")
    measured = await session.evaluate(_MEASURE)
    await session.evaluate("document.querySelectorAll('details').forEach((one) => one.open = true)")
    opened = await session.evaluate(_MEASURE)
    drawn = await session.evaluate(_PICTURES)
    faint = await session.evaluate(_FAINT)
    scrolled = await session.evaluate(_SCROLLED)
    png = b""
    if pictures:
        shot = await session.call("Page.captureScreenshot", format="png", captureBeyondViewport=True)
        png = base64.b64decode(shot["data"])
    outside = dict.fromkeys((*measured["outside"], *opened["outside"]))
    return Seen(
        width, scheme, max(measured["page"], opened["page"]), tuple(outside), tuple(faint), _complaints(session.events),
        tuple(drawn), tuple(scrolled), png,
    )  # fmt: skip


def _complaints(events: list[dict[str, Any]]) -> tuple[str, ...]:
    """What a browser says of a page: errors, warnings, and requests for anything that is not in it."""
    said = []
    for event in events:
        given = event["params"]
        if event["method"] == "Log.entryAdded" and given["entry"]["level"] in ("error", "warning"):
            said.append(given["entry"]["text"])
        elif event["method"] == "Runtime.exceptionThrown":
            said.append(given["exceptionDetails"]["text"])
        elif event["method"] == "Runtime.consoleAPICalled" and given["type"] in ("error", "warning", "assert"):
            said.append(str(given["args"]))
        elif event["method"] == "Network.requestWillBeSent" and given["type"] != "Document":
            address = given["request"]["url"]
            if not address.startswith("data:"):
                said.append(f"asks for {address}")
    return tuple(said)


def main() -> None:
    """Take pictures of pages and print what was measured."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pages", nargs="+", type=Path)
    parser.add_argument("--out", type=Path, default=Path(os.curdir))
    parser.add_argument("--widths", type=int, nargs="+", default=WIDTHS)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    for page in options.pages:
        for seen in look(page, options.widths, pictures=True):
            target = options.out / f"{page.resolve().parent.name}_{page.stem}_{seen.width}_{seen.scheme}.png"
            target.write_bytes(seen.png)
            print(target, seen.page, *seen.outside, *seen.scrolled, *seen.faint, *seen.complaints, sep="\n  ")


if __name__ == "__main__":
    main()
