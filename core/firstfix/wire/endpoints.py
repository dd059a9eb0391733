"""zenoh endpoints, ``protocol/address?metadata#config``: who can reach them, and what zenoh says of them."""

from __future__ import annotations

import ipaddress
import json
import re
from dataclasses import dataclass
from typing import Any

SCOUTING = "multicast scouting"
_HOST = re.compile(r"\[?([^\]/]*?)\]?(:\d+)?")
_LOCAL_PROTOCOLS = {"unixsock-stream", "unixpipe"}
_ENCRYPTED_PROTOCOLS = {"tls", "quic"}
ENDPOINT_FORM = "an endpoint is like tcp/HOST:7447"
# Names of types around a message, and places in zenoh's sources on the machine of its builder.
_OF_ZENOH = re.compile(r'\s*\bat \S+\.rs:\d+\.?|(\w+\()?Message \{ msg: "|", location: .*')


def said_by_zenoh(error: Exception) -> str:
    """Message of an error of zenoh."""
    return _OF_ZENOH.sub("", str(error))


@dataclass(frozen=True)
class Links:
    """Endpoints of a zenoh session, as its configuration has them.

    Attributes:
        connects: with ``SCOUTING``, if the session also connects to whom it finds.
    """

    listens: tuple[str, ...]
    connects: tuple[str, ...]

    @classmethod
    def of(cls, config: Any) -> Links:
        """Read a ``zenoh.Config``."""
        mode = _read(config, "mode") or "peer"
        listens = () if mode == "client" else _endpoints(config, "listen/endpoints", mode)
        connects = _endpoints(config, "connect/endpoints", mode)
        if _read(config, "scouting/multicast/enabled") is not False:
            connects += (SCOUTING,)
        return cls(listens, connects)

    @property
    def beyond(self) -> list[str]:
        """The endpoints that reach beyond this machine."""
        return [one for one in self.listens + self.connects if not is_local_endpoint(one)]

    @property
    def are_encrypted(self) -> bool:
        """True if nobody can read along on the endpoints beyond this machine."""
        return all(map(is_encrypted_endpoint, self.beyond))


def _endpoints(config: Any, name: str, mode: str) -> tuple[str, ...]:
    value = _read(config, name)
    if isinstance(value, dict):  # for each mode
        value = value.get(mode)
    return tuple(map(str, [value] if isinstance(value, str) else value or ()))


def _read(config: Any, name: str) -> Any:
    return json.loads(config.get_json(name))


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach the address."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def is_local_endpoint(endpoint: str) -> bool:
    """Whether an endpoint is on this machine only."""
    protocol, _, rest = endpoint.partition("/")
    if protocol in _LOCAL_PROTOCOLS:
        return True
    address = re.split(r"[?#]", rest)[0]
    match = _HOST.fullmatch(address)
    return match is not None and is_loopback(match[1])


def is_encrypted_endpoint(endpoint: str) -> bool:
    """Whether an endpoint speaks TLS, so that nobody reads along."""
    return endpoint.partition("/")[0] in _ENCRYPTED_PROTOCOLS
