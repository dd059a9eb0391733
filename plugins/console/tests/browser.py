"""A real browser, driven over the DevTools protocol: Debian's Chromium, headless, with software GL.

Its program without a window (chromium-headless-shell) is taken where it is installed: pages are the
same in it, and each costs less than half the processor time, as no window is opened and drawn round it.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from plugins.console.tests.page import Page
from tests.waiting import LIMIT_S, wait_until

HOST = "console.test"  # a name without TLS, as robots' networks have it: browsers offer less there
_WITHOUT_NETLINK = str(Path(__file__).with_name("without_netlink.py"))
_PROGRAMS = ("chromium-headless-shell", "chromium", "google-chrome")  # the first that is there
_ARGUMENTS = (
    "--headless=new",
    "--no-sandbox",  # containers seldom allow it
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-default-apps",
    "--disable-extensions",
    "--disable-sync",
    "--disable-quic",
    "--process-per-site",  # the pages of a profile share what their process has compiled
    # the popups below the address bar are pages, which every window would load
    "--disable-features=Translate,OptimizationHints,MediaRouter,WebUIOmniboxPopup,WebUIOmniboxAimPopup",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    # without a graphics card, the processor paints and composes the page sooner than software GL does
    "--disable-gpu-rasterization",
    "--disable-gpu-compositing",
    "--force-color-profile=srgb",
    "--hide-scrollbars",
    "--remote-debugging-port=0",
    f"--host-resolver-rules=MAP {HOST} 127.0.0.1",
)


class Browser:
    """A running browser."""

    def __init__(self, socket: ClientConnection, downloads: Path, pid: int) -> None:
        self.pid = pid
        self._socket = socket
        self._downloads = downloads
        self._number = 0
        self._lock = threading.Lock()
        self._answers: dict[int, Future[dict[str, Any]]] = {}
        self._hearers: dict[str, Callable[[str, dict[str, Any]], None]] = {}
        self._shared = ""  # profile
        self._staying: dict[str, str] = {}  # origin: session of a page in it
        threading.Thread(target=self._read, daemon=True).start()

    def call(self, method: str, session: str = "", **parameters: Any) -> dict[str, Any]:
        """Sends a command of the protocol and returns its result."""
        answer: Future[dict[str, Any]] = Future()
        with self._lock:
            self._number += 1
            self._answers[self._number] = answer
            message: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
            if session:
                message["sessionId"] = session
            self._socket.send(json.dumps(message))
        said = answer.result(LIMIT_S)
        assert "error" not in said, f"{method}: {said['error']}"
        return dict(said["result"])

    @contextmanager
    def page(self, origin: str, *, is_first_visit: bool = False) -> Iterator[Page]:
        """An empty page, which may ask that origin alone and finds nothing that another has stored.

        Args:
            is_first_visit: it has a profile of its own: its process starts anew and has compiled nothing.
        """
        context = self._profile() if is_first_visit else self._visited(origin)
        target, session = self._open("about:blank", context)
        page = Page(
            lambda method, **parameters: self.call(method, session, **parameters), origin, self._downloads
        )
        self._hearers[session] = page.hear
        try:
            page.begin()
            yield page
        finally:
            del self._hearers[session]
            if is_first_visit:
                self.call("Target.disposeBrowserContext", browserContextId=context)
            else:
                self.call("Target.closeTarget", targetId=target)

    def _visited(self, origin: str) -> str:
        """The profile of all other pages. One of them stays open: with it their process stays."""
        self._shared = self._shared or self._profile()
        if origin not in self._staying:
            self._staying[origin] = self._open(f"{origin}/console/notices.txt", self._shared)[1]
        stored = "local_storage"
        self.call("Storage.clearDataForOrigin", self._staying[origin], origin=origin, storageTypes=stored)
        return self._shared

    def _profile(self) -> str:
        context = str(self.call("Target.createBrowserContext")["browserContextId"])
        self._downloads.mkdir(exist_ok=True)
        self.call(
            "Browser.setDownloadBehavior",
            behavior="allow",
            browserContextId=context,
            downloadPath=str(self._downloads),
        )
        return context

    def _open(self, url: str, context: str) -> tuple[str, str]:
        """Opens a page: (target, session)."""
        target = self.call("Target.createTarget", url=url, browserContextId=context)["targetId"]
        return target, self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]

    def _read(self) -> None:
        try:
            for text in self._socket:
                message = json.loads(text)
                if "id" in message:
                    self._answers.pop(message["id"]).set_result(message)
                elif message.get("sessionId") in self._hearers:
                    self._hearers[message["sessionId"]](message["method"], message["params"])
        except ConnectionClosed:
            pass


@contextmanager
def running_browser(folder: Path) -> Iterator[Browser]:
    """Starts Chromium with an empty profile, and kills it at the end. Without it the test is skipped."""
    program = os.environ.get("CHROMIUM") or next(filter(None, map(shutil.which, _PROGRAMS)), None)
    if program is None:
        pytest.skip("needs chromium: apt-get install chromium-headless-shell")
    profile = folder / "profile"
    profile.mkdir(parents=True)
    with (folder / "chromium.log").open("wb") as log:
        process = subprocess.Popen(
            [
                sys.executable,
                _WITHOUT_NETLINK,
                program,
                *_ARGUMENTS,
                f"--user-data-dir={profile}",
                "about:blank",
            ],
            stdout=log,
            stderr=log,
            start_new_session=True,
        )
    port_file = profile / "DevToolsActivePort"
    try:
        wait_until(
            lambda: process.poll() is not None or (port_file.exists() and "\n/" in port_file.read_text())
        )
        if process.poll() is not None:
            pytest.fail(f"{program} did not start: {(folder / 'chromium.log').read_text()[-1000:]}")
        port, path = port_file.read_text().split()
        with connect(f"ws://127.0.0.1:{port}{path}", max_size=None, proxy=None) as socket:
            yield Browser(socket, folder / "downloads", process.pid)
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, 9)
        process.wait()
