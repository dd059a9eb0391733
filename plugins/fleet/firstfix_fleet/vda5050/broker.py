"""Connection to the MQTT broker: one thread, reconnects, and a last will that shows where the gateway is."""

from __future__ import annotations

import json
import os
import random
import select
import ssl
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import urlsplit

from paho.mqtt.client import Client, ConnectFlags, DisconnectFlags, MQTTMessage, MQTTv5, MQTTv311
from paho.mqtt.enums import CallbackAPIVersion, MQTTErrorCode
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode

from firstfix.errors import InvalidOption, NotFound

from .http_scan import MAX_SCAN_BYTES

PORTS = {"mqtt": 1883, "mqtts": 8883}
KEEPALIVE_S = 20
MAX_IN_A_ROW = 10_000  # messages, before other work has its turn
LOOK_S = 0.1  # between two looks at what else is to be done
FIRST_WAIT_S, MAX_WAIT_S = 0.5, 30.0  # between two tries to connect; it doubles
LEAVE_WITHIN_S = 5.0
STEADY_S = 10.0  # two clients of one name end each other's connections: a short one is no success
MAX_PACKET_BYTES = MAX_SCAN_BYTES + (64 << 10)  # MQTT 5: the broker leaves out what is larger
PRESENCE = "firstfix/vda5050-gateway"


@dataclass(frozen=True)
class BrokerAddress:
    """Address of a broker.

    Attributes:
        tls: encrypted.
    """

    host: str
    port: int
    tls: bool

    @classmethod
    def parse(cls, url: str) -> BrokerAddress:
        """Read ``mqtt://host[:1883]`` or ``mqtts://host[:8883]``.

        Raises:
            InvalidOption: another form, or one with a password, which everybody on the machine could read.
        """
        try:
            parts = urlsplit(url)
            host, port = parts.hostname, parts.port
        except ValueError:
            host = port = None
        if (
            not host
            or parts.scheme not in PORTS
            or parts.path not in ("", "/")
            or parts.query
            or parts.fragment
        ):
            raise InvalidOption("--broker: use mqtt://HOST[:PORT], or mqtts://HOST[:PORT] with TLS")
        if parts.username is not None or parts.password is not None:
            raise InvalidOption("--broker: give the user with --user, and the password in a file")
        return cls(host, port or PORTS[parts.scheme], parts.scheme == "mqtts")

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"


@dataclass(frozen=True)
class Login:
    """How the gateway shows who it is.

    Attributes:
        client_id: of this gateway alone: the broker ends the older connection of two that have it.
        ca: PEM file of the authorities that may sign the broker's certificate; None: those of the system.
        certificate: PEM file with the gateway's certificate and key.
    """

    client_id: str
    user: str | None = None
    password: str | None = None
    ca: Path | None = None
    certificate: Path | None = None

    def tls(self) -> ssl.SSLContext:
        """The context of encrypted connections.

        Raises:
            InvalidOption: a file cannot be read.
        """
        try:
            context = ssl.create_default_context(cafile=self.ca)
            if self.certificate is not None:
                context.load_cert_chain(self.certificate)
        except (OSError, ssl.SSLError) as error:
            files = ", ".join(str(one) for one in (self.ca, self.certificate) if one is not None)
            raise InvalidOption(f"{files}: {error}") from None
        return context


class Listener(Protocol):
    """Takes the events of a connection. Its methods are called in the connection's thread."""

    def connected(self) -> None:
        """A connection stands."""
        ...

    def disconnected(self) -> None:
        """It broke."""
        ...

    def take(self, topic: str, body: bytes, *, retained: bool) -> None:
        """A message came."""
        ...

    def tick(self) -> None:
        """Some time has passed."""
        ...


class Broker:
    """Connection to a broker. ``run`` is its thread; the other methods are called by the listener in it.

    Args:
        version: 5, or 3 for 3.1.1. With the latter the broker alone bounds the size of messages.
        log_line: takes a line when the connection comes or goes.
    """

    def __init__(
        self, address: BrokerAddress, login: Login, *, version: int, log_line: Callable[[str], None]
    ) -> None:
        self._address, self._log_line = address, log_line
        self._presence = f"{PRESENCE}/{login.client_id}"
        self._told = ""
        self._up, self._up_since_s = False, 0.0
        self._is_5 = version == 5
        self._listener: Listener | None = None
        self._client = Client(
            CallbackAPIVersion.VERSION2,
            login.client_id,
            clean_session=None if self._is_5 else True,
            protocol=MQTTv5 if self._is_5 else MQTTv311,
        )
        if login.user is not None:
            self._client.username_pw_set(login.user, login.password)
        if address.tls:
            self._client.tls_set_context(login.tls())
        self._client.will_set(self._presence, _presence("CONNECTIONBROKEN"), qos=1, retain=True)
        self._client.on_connect, self._client.on_disconnect = self._on_connect, self._on_disconnect
        self._client.on_message = self._on_message

    def publish(self, topic: str, body: bytes) -> bool:
        """Send a message with quality of service 0, as VDA 5050 wants it. Returns whether it was sent."""
        return self._up and self._client.publish(topic, body).rc == MQTTErrorCode.MQTT_ERR_SUCCESS

    def subscribe(self, topic: str) -> None:
        """Subscribes. Without a connection it does nothing: the listener does it again at ``connected``."""
        if self._up:
            self._client.subscribe(topic, qos=1)

    def unsubscribe(self, topic: str) -> None:
        """End a subscription."""
        if self._up:
            self._client.unsubscribe(topic)

    def run(self, listener: Listener, stop: threading.Event) -> None:
        """Block until ``stop`` is set; reconnects, with waits that grow and differ."""
        self._listener, wait_s = listener, FIRST_WAIT_S
        while not stop.is_set():
            try:
                self._connect()
                while not stop.is_set() and self._read():
                    if self._up and time.monotonic() - self._up_since_s > STEADY_S:
                        wait_s = FIRST_WAIT_S
                    listener.tick()
            except (OSError, ValueError) as error:  # ValueError: a host that is no name
                self._tell(f"no connection to the broker at {self._address}: {error}")
            if stop.is_set():
                break
            self._lose()
            self._wait(stop, wait_s * random.uniform(0.5, 1.0))
            wait_s = min(2 * wait_s, MAX_WAIT_S)
        self._leave()

    def _read(self) -> bool:
        """Read what has come. Returns whether the connection stands.

        All that waits is read before the listener acts: an order to drive may be among it.
        """
        result = self._client.loop(LOOK_S)
        for _ in range(MAX_IN_A_ROW):
            connection = self._client.socket()
            if result != MQTTErrorCode.MQTT_ERR_SUCCESS or connection is None:
                break
            if not select.select([connection], [], [], 0)[0]:
                break
            result = self._client.loop(0)
        return result == MQTTErrorCode.MQTT_ERR_SUCCESS

    def _connect(self) -> None:
        properties = None
        if self._is_5:
            properties = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]
            properties.MaximumPacketSize = MAX_PACKET_BYTES
        self._client.connect(self._address.host, self._address.port, KEEPALIVE_S, properties=properties)

    def _wait(self, stop: threading.Event, seconds: float) -> None:
        assert self._listener is not None
        for _ in range(max(1, round(seconds / LOOK_S))):
            if stop.wait(LOOK_S):
                return
            self._listener.tick()

    def _leave(self) -> None:
        if not self._up:
            return
        # Its acknowledgement is waited for: a close with answers unread would reset the connection, and the
        # broker could lose what it has not read yet.
        offline = self._client.publish(self._presence, _presence("OFFLINE"), qos=1, retain=True)
        self._up = False  # the listener keeps what it knows
        end = time.monotonic() + LEAVE_WITHIN_S
        result = offline.rc
        while (
            result == MQTTErrorCode.MQTT_ERR_SUCCESS and not offline.is_published() and time.monotonic() < end
        ):
            result = self._client.loop(LOOK_S)
        self._client.disconnect()
        while self._client.loop(LOOK_S) == MQTTErrorCode.MQTT_ERR_SUCCESS:
            pass

    def _lose(self) -> None:
        if self._up:
            self._up = False
            assert self._listener is not None
            self._listener.disconnected()

    def _on_connect(
        self, client: Client, data: Any, flags: ConnectFlags, reason: ReasonCode, properties: Any
    ) -> None:
        if reason.is_failure:
            self._tell(f"the broker at {self._address} refuses: {reason}")
            return
        self._up, self._up_since_s = True, time.monotonic()
        self._tell(f"connected to the broker at {self._address}")
        client.publish(self._presence, _presence("ONLINE"), qos=0, retain=True)
        assert self._listener is not None
        self._listener.connected()

    def _on_disconnect(
        self, client: Client, data: Any, flags: DisconnectFlags, reason: ReasonCode, properties: Any
    ) -> None:
        if self._up:
            self._tell(f"the connection to the broker at {self._address} ended: {reason}")
        self._lose()

    def _on_message(self, client: Client, data: Any, message: MQTTMessage) -> None:
        assert self._listener is not None
        try:
            topic = message.topic
        except UnicodeDecodeError:
            return
        try:
            self._listener.take(topic, bytes(message.payload), retained=message.retain)
        except Exception as error:  # a defect must not end the connection
            self._log_line(f"defect: {error!r}"[:500])

    def _tell(self, line: str) -> None:
        if line != self._told:
            self._told = line
            self._log_line(line)


def _presence(state: str) -> bytes:
    return json.dumps({"connectionState": state}).encode()


def password_of(file: Path | None) -> str | None:
    """The first line of a file, or the environment's FIRSTFIX_MQTT_PASSWORD; None: neither.

    Raises:
        NotFound, InvalidOption: the file cannot be read, or has no line.
    """
    if file is None:
        return os.environ.get("FIRSTFIX_MQTT_PASSWORD") or None
    try:
        with file.open(encoding="utf-8") as lines:
            password = lines.readline(4096).rstrip("\r\n")
    except (OSError, ValueError) as error:
        raise NotFound(f"{file}: {error}") from None
    if not password:
        raise InvalidOption(f"{file}: its first line is empty")
    return password
