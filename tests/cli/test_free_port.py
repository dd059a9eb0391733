"""Ports for servers that commands start: each is given once, and none that another server has."""

from __future__ import annotations

import socket

import pytest

from firstfix_cli import free_port as module
from firstfix_cli.free_port import free_port, port_is_free
from servers import free_port as claimed_port


def _alone(port: int) -> range:
    return range(port, port + 1)


def test_a_service_gets_two_ports(monkeypatch) -> None:
    few = _alone(claimed_port())
    other = _alone(claimed_port())
    monkeypatch.setattr(module, "_PORTS", few)
    assert free_port() == few[0]
    with pytest.raises(OSError, match="no free TCP port"):
        free_port()  # nothing listens on it yet, but it is given
    monkeypatch.setattr(module, "_PORTS", other)
    assert free_port() == other[0]


def test_a_port_on_which_a_server_listens_is_not_given(monkeypatch) -> None:
    port = claimed_port()
    monkeypatch.setattr(module, "_PORTS", _alone(port))
    with socket.create_server(("127.0.0.1", port)):
        assert not port_is_free(port)
        with pytest.raises(OSError, match="no free TCP port"):
            free_port()
    assert port_is_free(port)
