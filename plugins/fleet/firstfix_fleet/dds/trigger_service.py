"""A service of type std_srvs/srv/Trigger over DDS.

Each implementation of ROS 2 joins requests and replies in its own way. rmw_cyclonedds writes 16 bytes
before the request, and expects them before the reply. rmw_fastrtps and rmw_connextdds send the identity of
the request beside the message (inline QoS), which the Python binding of Cyclone DDS neither reads nor writes:
their requests are carried out, and cannot be answered.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import Any

from firstfix.errors import InputError
from firstfix.ros.cdr import CdrWriter, MessageReader
from firstfix.ros.type_hashes import TRIGGER

from . import qos
from .participant import REPLY, REQUEST, Participant

CANNOT = (
    "clients of the service first_fix/relocalize on rmw_fastrtps or rmw_connextdds get no reply, though it "
    "does what they ask. Where a ROS 2 is sourced, go without --dds: then they do"
)
DEPTH = 10  # of ROS 2's services
_PATIENCE_S = 1.0  # a reply waits so long until its reader is matched
_MAX_WAITING = 100
_HEADER_BYTES = 16


class TriggerService:
    """One service.

    Args:
        name: full name, with the first slash.
        call: carries out a request; returns the line of the reply.
        log_line: takes a line about a request that cannot be answered.
    """

    def __init__(
        self,
        participant: Participant,
        name: str,
        call: Callable[[], str],
        log_line: Callable[[str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._participant, self._call, self._log_line, self._clock = participant, call, log_line, clock
        self._replies = participant.writer(f"{REPLY}{name}Reply", f"{TRIGGER}_Response", qos.reliable(DEPTH))
        self._requests = participant.read(
            f"{REQUEST}{name}Request", f"{TRIGGER}_Request", qos.reliable(DEPTH), self._on_request
        )
        self._waiting: deque[tuple[float, Any, bytes]] = deque(maxlen=_MAX_WAITING)

    def close(self) -> None:
        """Remove the service."""
        self._participant.stop_reading(self._requests)

    def send_waiting(self) -> None:
        """Send the replies whose readers are matched by now. Without its reader a reply would be lost."""
        if not self._waiting:
            return
        readers = self._replies.readers()
        for _ in range(len(self._waiting)):
            until_s, client, reply = self._waiting.popleft()
            if client is None or client in readers or self._clock() >= until_s:
                try:
                    self._replies.write(reply)
                except ConnectionError as error:
                    self._log_line(str(error))
            else:
                self._waiting.append((until_s, client, reply))

    def _on_request(self, body: bytes, info: Any) -> None:
        try:
            header = request_header(body)
        except InputError as error:
            self._log_line(str(error))
            return
        line = self._call()
        if header is None:
            self._log_line("a client of another DDS asked: it is done, but Cyclone DDS cannot answer it")
            return
        publication = self._requests.get_matched_publication_data(info.publication_handle)
        client = None if publication is None else publication.participant_key
        self._waiting.append((self._clock() + _PATIENCE_S, client, trigger_reply(header, line)))
        self.send_waiting()


def request_header(body: bytes) -> tuple[int, int] | None:
    """The header of a request of rmw_cyclonedds: half of the client's GUID, and the request's number.

    Returns:
        None for the request of another implementation, which has no header.

    Raises:
        MalformedData, UnsupportedFormat: not a request.
    """
    reader = MessageReader("Trigger", body)
    has_header = len(body) > _HEADER_BYTES + 4
    header = (reader.number("Q"), reader.number("q")) if has_header else None
    reader.number("B")
    reader.end()
    return header


def trigger_reply(header: tuple[int, int], line: str) -> bytes:
    """A reply of rmw_cyclonedds: the request's header, then success and a message."""
    writer = CdrWriter()
    writer.numbers("Q", header[:1])
    writer.numbers("q", header[1:])
    writer.numbers("B", [True])
    writer.text(line)
    return writer.bytes()
