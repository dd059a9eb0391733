"""Address of a vehicle's scan, with the names of the vehicle in it."""

from __future__ import annotations

import re
import socket
from urllib.parse import quote, urlsplit

from firstfix.errors import InvalidOption

from .topics import MAX_TOPIC_CHARS, VehicleName

MQTT = "mqtt:"
_NAMES = ("interface", "major", "manufacturer", "serial")
_FIELD = re.compile(r"\{([^{}]*)\}")
_IN_HOST = re.compile(r"[A-Za-z0-9]([A-Za-z0-9-]{0,61}[A-Za-z0-9])?\Z")


class ScanAddress:
    """Template of a URL, or of a topic of the same broker after ``mqtt:``.

    ``{manufacturer}``, ``{serial}``, ``{interface}`` and ``{major}`` stand for the names of the vehicle.

    Raises:
        InvalidOption: neither of them, or another name in braces.
    """

    def __init__(self, template: str) -> None:
        self._template = template
        for name in _FIELD.findall(template):
            if name not in _NAMES:
                raise InvalidOption(f"scan: {name[:40]!r} is none of {', '.join(_NAMES)}")
        if "serial" not in _FIELD.findall(template):
            raise InvalidOption("scan: without {serial} all vehicles would have the same scan")
        if self.is_topic:
            if not template[len(MQTT) :] or any(sign in template for sign in "+#"):
                raise InvalidOption(f"scan: {template!r} names no topic")
            return
        parts = urlsplit(_FIELD.sub("x", template))
        if parts.scheme not in ("http", "https") or not parts.hostname or "@" in parts.netloc:
            raise InvalidOption(
                f"scan: {template[:200]!r} is neither mqtt:TOPIC nor an http or https URL without a password"
            )

    @property
    def is_topic(self) -> bool:
        """True for a topic, false for a URL."""
        return self._template.startswith(MQTT)

    def of(self, vehicle: VehicleName) -> str:
        """A vehicle's topic or URL.

        Whoever may publish at the broker chooses the names. In a URL they stay within the template: a name
        becomes neither a path nor an address of its own.

        Raises:
            InvalidOption: the names cannot be part of the address.
        """
        names = {name: getattr(vehicle, name) for name in _NAMES}
        if self.is_topic:
            topic = _FIELD.sub(lambda found: names[found[1]], self._template[len(MQTT) :])
            if len(topic) > MAX_TOPIC_CHARS:
                raise InvalidOption("the topic of its scan is too long")
            return topic
        parts = urlsplit(self._template)
        host = parts.netloc
        begin = f"{parts.scheme}://"
        path = self._template[len(begin) + len(host) :]
        if _FIELD.search(host):
            for name in _FIELD.findall(host):
                if not _IN_HOST.match(names[name]):
                    raise InvalidOption(f"its {name} cannot be part of a host's name")
            host = _FIELD.sub(lambda found: names[found[1]], host)
            if _is_number(urlsplit(f"//{host}").hostname or ""):
                raise InvalidOption("its names would make the address of a machine")
        for name in _FIELD.findall(path):
            if names[name] in (".", ".."):
                raise InvalidOption(f"its {name} cannot be part of a path")
        return f"{begin}{host}" + _FIELD.sub(lambda found: quote(names[found[1]], safe=""), path)


def _is_number(host: str) -> bool:
    """True for an IPv4 address in any of its forms, such as 2130706433."""
    try:
        socket.inet_aton(host)
    except OSError:
        return False
    return True
