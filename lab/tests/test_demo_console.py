"""The end of the demo: it says where the console is, and stays there when it is told to."""

from __future__ import annotations

import io
import threading
from pathlib import Path

import httpx
import pytest
from rich.console import Console

from firstfix_cli.local_service import LocalService, local_service
from firstfix_console.page import page_files
from firstfix_lab.demo import offer_console
from tests.servers import free_port
from tests.waiting import LIMIT_S, wait_until

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not page_files(), reason="needs the console: make console"),
]


def offered(service: LocalService) -> tuple[io.StringIO, threading.Thread]:
    """The text that is printed, and the thread that prints it."""
    said = io.StringIO()
    thread = threading.Thread(
        target=offer_console, args=(Console(file=said, width=200), service), daemon=True
    )
    thread.start()
    return said, thread


def test_the_demo_ends_with_the_consoles_address(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    port = free_port()
    with local_service(tmp_path / "service", tmp_path / "store", port) as service:
        address = f"http://127.0.0.1:{port}/console/"
        # It may answer before it has said so.
        wait_until(lambda: "listening" in service.log.read_text(), what="it says where it listens")
        assert address in service.log.read_text()
        for value in ("", "0"):
            monkeypatch.setenv("OPEN", value)
            said, thread = offered(service)
            thread.join(LIMIT_S)
            assert not thread.is_alive()
            assert address in said.getvalue()
            assert "make demo OPEN=1" in said.getvalue()
        monkeypatch.setenv("OPEN", "1")
        said, thread = offered(service)
        wait_until(lambda: "Ctrl-C" in said.getvalue())
        assert address in said.getvalue()
        assert httpx.get(address).is_success
        assert thread.is_alive(), "it waits for the service"
        service.process.terminate()
        thread.join(LIMIT_S)
        assert not thread.is_alive()


def test_a_port_that_is_taken_is_not_waited_for(tmp_path: Path):
    with local_service(tmp_path / "first", tmp_path / "store") as first:
        port = int(first.url.rpartition(":")[2])
        with local_service(tmp_path / "second", tmp_path / "store", port) as second:
            assert second.url != first.url
            assert httpx.get(f"{second.url}/readyz").is_success
