"""A page of the browser, used as people use it: by what they read, with the mouse and the keys."""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tests.waiting import wait_until

LIMIT_S = 120.0
CANVAS = ".map-canvas"

# Found by the selector and by the words that a reader of the screen would hear: all of them are in its name.
_FIND = """
globalThis.find = (selector, words) => {
  const labels = (e) => [...(e.labels ?? [])].map((l) => l.textContent).join(' ');
  const nameOf = (e) => [e.getAttribute('aria-label'), labels(e), e.textContent,
    e.title].filter(Boolean).join(' ').replace(/\\s+/g, ' ');
  const isIt = (e) => e.getClientRects().length && nameOf(e).includes(words);
  return [...document.querySelectorAll(selector)].find(isIt);
};
"""
_KEYS = {
    "Enter": ("Enter", 13, "\r"),
    "Escape": ("Escape", 27, ""),
    "Tab": ("Tab", 9, ""),
    "Space": ("Space", 32, " "),
    "t": ("KeyT", 84, "t"),
    "?": ("Slash", 191, "?"),
    "ArrowRight": ("ArrowRight", 39, ""),
    "ArrowLeft": ("ArrowLeft", 37, ""),
    "ArrowUp": ("ArrowUp", 38, ""),
    "ArrowDown": ("ArrowDown", 40, ""),
}
_SHIFT = 8
_LOOK_MS = 40  # from one look of a waiting page to the next
_LOOKS_MS = 2000  # until it says that there is nothing yet
Picture = NDArray[np.uint8]  # (h, w, 3)


class Page:
    """One page. ``problems`` collects errors of the page and requests to other hosts."""

    def __init__(self, call: Callable[..., dict[str, Any]], origin: str, downloads: Path) -> None:
        self.call = call
        self.origin = origin
        self.problems: list[str] = []
        self.expected: list[str] = []  # texts of errors that the test provokes
        self.asked: list[str] = []  # "GET /path" of each request
        self.window_px = (0, 0)
        self._downloads = downloads

    def begin(self) -> None:
        for domain in ("Page", "Runtime", "Network", "Log", "DOM"):
            self.call(f"{domain}.enable")
        self.call("Page.addScriptToEvaluateOnNewDocument", source=_FIND)
        self.size(1280, 800)

    def hear(self, event: str, told: dict[str, Any]) -> None:
        """Takes an event of the browser."""
        if event == "Network.requestWillBeSent":
            url = urlsplit(told["request"]["url"])
            self.asked.append(f"{told['request']['method']} {url.path}")
            if url.scheme not in ("data", "blob", "about") and f"{url.scheme}://{url.netloc}" != self.origin:
                self._problem(f"a request to {told['request']['url']}")
        elif event == "Runtime.exceptionThrown":
            details = told["exceptionDetails"]
            self._problem(str(details.get("exception", {}).get("description") or details["text"]))
        elif event == "Runtime.consoleAPICalled" and told["type"] in ("error", "warning", "assert"):
            self._problem(" ".join(str(one.get("value", one.get("description"))) for one in told["args"]))
        elif event == "Log.entryAdded" and told["entry"]["level"] in ("error", "warning"):
            self._problem(f"{told['entry']['text']} {told['entry'].get('url', '')}")

    def _problem(self, text: str) -> None:
        # drivers of graphics cards grumble about slow calls, which is no fault of the page
        if "GL Driver Message" not in text and not any(one in text for one in self.expected):
            self.problems.append(text)

    # What is there.

    def js(self, expression: str) -> Any:
        """The value of an expression in the page. Promises are awaited."""
        said = self.call(
            "Runtime.evaluate",
            expression=expression,
            awaitPromise=True,
            returnByValue=True,
            userGesture=True,
        )
        if "exceptionDetails" in said:
            raise AssertionError(f"{expression}: {said['exceptionDetails'].get('exception', said)}")
        return said["result"].get("value")

    def text(self, selector: str = "body") -> str:
        return str(self.js(f"document.querySelector({json.dumps(selector)})?.innerText ?? ''"))

    def has(self, selector: str, words: str = "") -> bool:
        return bool(self.js(f"!!find({json.dumps(selector)}, {json.dumps(words)})"))

    def wait(self, selector: str, words: str = "") -> None:
        """Waits until an element is there whose name has these words."""
        self.until(f"!!find({json.dumps(selector)}, {json.dumps(words)})", f"{selector} {words!r}")

    def until(self, expression: str, what: str = "") -> None:
        """Waits until an expression holds. The page looks itself: to be asked costs it more than to look."""
        looks = (
            f"(async () => {{ const end = performance.now() + {_LOOKS_MS};"
            f" for (;;) {{ if ({expression}) return true; if (performance.now() > end) return false;"
            f" await new Promise((next) => setTimeout(next, {_LOOK_MS})); }} }})()"
        )
        self._wait(lambda: self.js(looks), what or expression)

    def _wait(self, condition: Callable[[], object], what: str) -> None:
        try:
            wait_until(condition, LIMIT_S, what)
        except AssertionError as error:
            raise AssertionError(f"{error}; {self.problems}; the page says: {self.text()[:2000]}") from None

    def count(self, selector: str) -> int:
        return int(self.js(f"document.querySelectorAll({json.dumps(selector)}).length"))

    def map_picture(self) -> Picture:
        """Picture of the map, once all its points for this view are there."""
        self.until(f"document.querySelector('{CANVAS}')?.getAttribute('aria-busy') === 'false'")
        self.js("new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(() => drawn())))")
        return self.picture(CANVAS)

    def picture(self, selector: str = "body") -> Picture:
        """Picture of an element, as it is seen."""
        x, y, width, height = self.box(selector)
        clip = {"x": x, "y": y, "width": width, "height": height, "scale": 1}
        png = self.call("Page.captureScreenshot", format="png", clip=clip, optimizeForSpeed=True)["data"]
        return np.array(Image.open(io.BytesIO(base64.b64decode(png))).convert("RGB"))

    # What a person does.

    def open(self, address: str = "") -> None:
        """Opens an address below the console, "#/maps/hall" for instance, as from a link in a message."""
        self.call("Page.navigate", url="about:blank")
        self.call("Page.navigate", url=f"{self.origin}/console/{address}")
        there = (
            "document.readyState === 'complete' && !!globalThis.find && !!document.querySelector('#app *')"
        )
        self._wait(lambda: self.js(there), address)  # asked again and again: a page that looks may be left

    def click(self, selector: str, words: str = "") -> None:
        """Clicks an element once it rests; again, if it has moved away from under the mouse all the same."""
        self.wait(f"{selector}:not(:disabled)", words)
        found = f"find({json.dumps(selector)}, {json.dumps(words)})"
        self.js("globalThis.isClicked = false")

        def click() -> Any:
            box = self.box(selector, words)
            self.js("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
            # The page may have put another element in its place since the last try.
            self.js(
                f"{found}?.addEventListener('click', () => (isClicked = true),"
                " { capture: true, once: true })"
            )
            if self.box(selector, words) != box:
                return False
            # A link over two lines may have nothing in the middle of both.
            middle = self.js(
                f"{{ const [line] = {found}?.getClientRects() ?? [];"
                " line && [line.x + line.width / 2, line.y + line.height / 2]; }"
            )
            if middle:
                self.click_at(*middle)
            return self.js("isClicked")

        wait_until(click, LIMIT_S, f"click on {selector} {words!r}")

    def click_at(self, x: float, y: float) -> None:
        for kind in ("mouseMoved", "mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        x, y = start
        self.call("Input.dispatchMouseEvent", type="mousePressed", x=x, y=y, button="left", clickCount=1)
        x, y = end
        self.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y, button="left", buttons=1)
        self.call("Input.dispatchMouseEvent", type="mouseReleased", x=x, y=y, button="left", clickCount=1)

    def fill(self, words: str, text: str, selector: str = "input") -> None:
        """Types a text into the field of that label, in place of what it has."""
        self.wait(selector, words)
        field = f"find({json.dumps(selector)}, {json.dumps(words)})"
        self.js(f"{field}.focus(); {field}.select?.()")
        self.call("Input.insertText", text=text)

    def choose(self, words: str, option: str) -> None:
        """Chooses an option, by its text, in the list of that label."""
        quoted = json.dumps(option)
        self.until(
            f"[...(find('select', {json.dumps(words)})?.options ?? [])].some((o) => o.text === {quoted})"
        )
        self.js(
            f"{{ const list = find('select', {json.dumps(words)});"
            f" list.value = [...list.options].find((o) => o.text === {quoted}).value;"
            " list.dispatchEvent(new Event('change', { bubbles: true })); }"
        )

    def press(self, key: str, shift: bool = False) -> None:
        code, number, text = _KEYS[key]
        common = {
            "key": " " if key == "Space" else key,
            "code": code,
            "windowsVirtualKeyCode": number,
            "modifiers": _SHIFT if shift else 0,
        }
        self.call("Input.dispatchKeyEvent", type="keyDown" if text else "rawKeyDown", text=text, **common)
        self.call("Input.dispatchKeyEvent", type="keyUp", **common)

    def drop(self, selector: str, *files: Path, words: str = "") -> None:
        """Lets files fall on an element."""
        self.wait(selector, words)
        x, y, width, height = self.box(selector, words)
        data = {"items": [], "files": [str(file) for file in files], "dragOperationsMask": 1}
        for kind in ("dragEnter", "dragOver", "drop"):
            self.call("Input.dispatchDragEvent", type=kind, x=x + width / 2, y=y + height / 2, data=data)

    def give_file(self, selector: str, file: Path) -> None:
        """Chooses a file in the browser's dialog of that field."""
        self.wait(selector)
        root = self.call("DOM.getDocument")["root"]["nodeId"]
        node = self.call("DOM.querySelector", nodeId=root, selector=selector)["nodeId"]
        self.call("DOM.setFileInputFiles", nodeId=node, files=[str(file)])

    def keep_key(self, key: str) -> None:
        """Signs in with an API key, as if it had been given in this tab before."""
        self.call(
            "Page.addScriptToEvaluateOnNewDocument",
            source=f"if (location.host) sessionStorage.setItem('firstfix.key', {json.dumps(key)})",
        )

    def hasten(self) -> None:
        """Has the next page look each second for what it looks for every few seconds."""
        self.call(
            "Page.addScriptToEvaluateOnNewDocument",
            source="{ const every = setInterval;"
            " globalThis.setInterval = (look, ms, ...more) => every(look, Math.min(ms, 1000), ...more); }",
        )

    def size(self, width: int, height: int, *, phone: bool = False) -> None:
        self.window_px = (width, height)
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=phone,
        )

    def pasted(self) -> str:
        """The text of the clipboard, as another program would get it."""
        self.js(
            "globalThis.paper = document.createElement('textarea');"
            "(document.querySelector('dialog') ?? document.body).append(paper); paper.focus()"
        )
        self.call("Input.dispatchKeyEvent", type="keyDown", key="v", modifiers=2, commands=["Paste"])
        return str(self.js("{ const text = paper.value; paper.remove(); text; }"))

    def prefers(self, scheme: str) -> None:
        """``dark`` or ``light``."""
        self.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])

    def downloaded(self, name: str) -> Path:
        """A file that the page saved, once all of it is there."""
        path = self._downloads / name
        wait_until(
            lambda: path.exists() and not list(self._downloads.glob("*.crdownload")),
            what=f"download of {name}",
        )
        return path

    def box(self, selector: str, words: str = "") -> tuple[float, float, float, float]:
        found = f"find({json.dumps(selector)}, {json.dumps(words)})"
        self.wait(selector, words)
        box = self.js(
            f"{{ const e = {found}; e.scrollIntoView({{ block: 'nearest' }});"
            " const b = e.getBoundingClientRect(); [b.x, b.y, b.width, b.height]; }"
        )
        return tuple(box)
