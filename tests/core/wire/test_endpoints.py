"""zenoh endpoints and whole configurations: who can reach them, and who can read along."""

from __future__ import annotations

import json

import pytest
import zenoh

from firstfix.wire.endpoints import SCOUTING, Links, is_encrypted_endpoint, is_local_endpoint


@pytest.mark.parametrize(
    ("endpoint", "is_local", "is_encrypted"),
    [
        ("tcp/127.0.0.1:7447", True, False),
        ("tcp/[::1]:7447?prio=1#iface=lo", True, False),
        ("unixsock-stream//run/a.sock", True, False),
        ("tcp/0.0.0.0:7447", False, False),
        ("tcp/localhost.evil.example:7447", False, False),
        ("tls/192.0.2.1:7447", False, True),
        ("quic/robot.example:7447", False, True),
        ("tlsx/robot.example:7447", False, False),
        ("", False, False),
        (SCOUTING, False, False),
    ],
)
def test_endpoints_are_local_and_encrypted_by_their_form(endpoint: str, is_local: bool, is_encrypted: bool):
    assert is_local_endpoint(endpoint) is is_local
    assert is_encrypted_endpoint(endpoint) is is_encrypted


def links(**given: object) -> Links:
    config = zenoh.Config()
    for name, value in given.items():
        config.insert_json5(name.replace("__", "/"), json.dumps(value))
    return Links.of(config)


def test_a_configuration_without_endpoints_is_open():
    assert links() == Links(("tcp/[::]:0",), (SCOUTING,))
    assert links(mode="router").listens == ("tcp/[::]:7447",)
    assert links(mode="client", scouting__multicast__enabled=False) == Links((), ())


def test_endpoints_of_its_mode_count():
    quiet = {"scouting__multicast__enabled": False}
    found = links(
        mode="peer", listen__endpoints={"peer": ["tcp/127.0.0.1:1"], "router": ["tcp/0:1"]}, **quiet
    )
    assert found.beyond == []
    assert found.are_encrypted
    mixed = links(listen__endpoints=[], connect__endpoints=["tls/a:1", "tcp/b:1"], **quiet)
    assert mixed.beyond == ["tls/a:1", "tcp/b:1"]
    assert not mixed.are_encrypted
