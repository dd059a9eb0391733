"""The console behind a proxy that puts a prefix before every path, as the documentation sets it up."""

from __future__ import annotations

import re
from pathlib import Path
from urllib.parse import urljoin

import httpx
import pytest

from firstfix_console import page
from tests.servers import free_port, program, running
from tests.service.service_world import SCAN_BODY, XYZ, publish, running_service
from tests.waiting import LIMIT_S, wait_until

PAGE = Path(__file__).parents[3] / "docs" / "how-to" / "console.md"
BASICS = "defaults\n  mode http\n  timeout connect 5s\n  timeout client 60s\n  timeout server 60s\n"
INDEX = b'<script type="module" src="./assets/index-a1.js"></script>'
SCRIPT = b"export {};"

pytestmark = pytest.mark.slow


def documented(port: int, service_url: str) -> str:
    """The proxy's file of the page, with this machine's ports."""
    (config,) = re.findall(r"```haproxy\n(.*?)```", PAGE.read_text(), re.DOTALL)
    config, ports = re.subn(r"(?m)bind :8080$", f"bind 127.0.0.1:{port}", config)
    config, servers = re.subn(r"127\.0\.0\.1:8000", service_url.removeprefix("http://"), config)
    assert (ports, servers) == (1, 1)
    return f"{BASICS}\n{config}"


def test_the_page_and_its_calls_work_under_a_prefix(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    haproxy = program("haproxy", "make all-test-servers installs it, for root")
    (tmp_path / "page" / "assets").mkdir(parents=True)
    (tmp_path / "page" / "index.html").write_bytes(INDEX)
    (tmp_path / "page" / "assets" / "index-a1.js").write_bytes(SCRIPT)
    monkeypatch.setattr(page, "page_files", lambda: page.read_page(tmp_path / "page"))
    with running_service(tmp_path, zenoh=False) as service:
        publish(service.catalog, "hall", "1", service.scratch)
        config, port = tmp_path / "haproxy.cfg", free_port()
        config.write_text(documented(port, service.url))
        proxy = running([haproxy, "-db", "-f", str(config)], port, tmp_path / "haproxy.log")
        with proxy, httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=LIMIT_S) as browser:
            for path in ("/lidar", "/lidar/", "/lidar/console"):
                shown = browser.get(path, follow_redirects=True)
                assert shown.url.path == "/lidar/console/", path
                assert shown.content == INDEX
            (script,) = re.findall(rb'src="([^"]+)"', shown.content)
            assert browser.get(urljoin(str(shown.url), script.decode())).content == SCRIPT
            # as the page does: its calls are one level above it
            root = urljoin(str(shown.url), "..")
            assert root.endswith("/lidar/")
            assert browser.get(root + "caller").json()["authentication"] is False
            asked = {
                "url": root + "localize?map=hall",
                "content": SCAN_BODY,
                "headers": {"Content-Type": XYZ},
            }
            wait_until(lambda: browser.post(**asked).status_code == 200)
            with browser.stream("GET", root + "answers/events") as stream:
                told = (line for line in stream.iter_lines() if line.startswith("data: "))
                assert any('"map_id":"hall"' in line for line in told)
            assert browser.get("/maps").status_code == 503, "the prefix is the only way in"
