"""Ports for servers that commands start: each is given once, and none that another server has."""

from __future__ import annotations

import socket

import pytest

from firstfix_cli import free_port as module
from firstfix_cli.free_port import free_port
from tests.servers import free_port as claimed_port


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
    with socket.create_server(("127.0.0.1", port)), pytest.raises(OSError, match="no free TCP port"):
        free_port()
    assert free_port() == port


def test_a_wanted_port_is_given_once_and_to_nobody_else(monkeypatch) -> None:
    wanted = claimed_port()
    other = claimed_port()
    monkeypatch.setattr(module, "_PORTS", (wanted, other))
    assert free_port(wanted) == wanted
    assert free_port() == other  # nothing listens on the wanted one yet


def test_a_wanted_port_that_is_taken_is_replaced(monkeypatch) -> None:
    taken, other = claimed_port(), claimed_port()
    monkeypatch.setattr(module, "_PORTS", _alone(other))
    with socket.create_server(("127.0.0.1", taken)):
        assert free_port(taken) == other
