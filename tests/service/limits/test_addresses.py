from __future__ import annotations

from ipaddress import ip_network

import pytest

from firstfix_service.limits.addresses import client_address

PROXIES = (ip_network("10.0.0.0/8"), ip_network("fd00::/8"))


@pytest.mark.parametrize(
    ("peer", "forwarded", "address"),
    [
        ("192.0.2.1", [], "192.0.2.1"),
        ("192.0.2.1", ["198.51.100.9"], "192.0.2.1"),  # written by a stranger
        ("10.0.0.1", ["198.51.100.9"], "198.51.100.9"),
        ("10.0.0.1", ["203.0.113.7, 198.51.100.9"], "198.51.100.9"),  # anybody can write the first one
        ("10.0.0.1", ["203.0.113.7", "198.51.100.9, 10.0.0.2"], "198.51.100.9"),
        ("10.0.0.1", ["10.0.0.3"], "10.0.0.3"),
        ("10.0.0.1", [], "10.0.0.1"),
        ("10.0.0.1", ["garbage"], "10.0.0.1"),
        ("10.0.0.1", ["198.51.100.9, garbage"], "10.0.0.1"),
        ("fd00::1", ["2001:db8:1:2:3:4:5:6"], "2001:db8:1:2::/64"),
        ("::ffff:192.0.2.1", [], "192.0.2.1"),
        ("2001:db8:1:2:3:4:5:7", [], "2001:db8:1:2::/64"),
        (None, ["198.51.100.9"], "unknown"),
        ("testclient", [], "unknown"),
    ],
)
def test_the_nearest_caller_that_is_no_proxy(peer: str | None, forwarded: list[str], address: str):
    assert client_address(peer, forwarded, PROXIES) == address


def test_without_trusted_proxies_the_header_is_nothing():
    assert client_address("10.0.0.1", ["198.51.100.9"], ()) == "10.0.0.1"
