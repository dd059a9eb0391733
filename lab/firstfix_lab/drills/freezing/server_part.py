"""A server that the service uses, as a part: it is frozen with its children, and started again when dead."""

from __future__ import annotations

import socket
import time

from .part import Effect
from .processes import Member

START_S = 200.0


class ServerPart:
    """A part with a process of its own.

    Args:
        member: the server's process.
        port: at which it listens; None: it is ready at once.
    """

    def __init__(self, name: str, member: Member, port: int | None, effect: Effect) -> None:
        self.name, self.effect = name, effect
        self._member, self._port = member, port

    def start(self) -> None:
        self._member.start()
        deadline = time.monotonic() + START_S
        while self._port is not None:
            try:
                socket.create_connection(("127.0.0.1", self._port), timeout=1).close()
                return
            except OSError:
                if self._member.has_ended or time.monotonic() > deadline:
                    raise RuntimeError(f"{self.name} did not start: see {self._member.log}") from None
                time.sleep(0.05)

    def freeze(self) -> None:
        self._member.freeze()

    def thaw(self) -> None:
        self._member.thaw()

    def kill(self) -> None:
        self._member.kill()
