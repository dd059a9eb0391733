"""Looks at scans, for people: other work on a body than a query, done by a worker all the same."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

from firstfix.engine.map_choice.sought_scan import SoughtScan
from firstfix.formats.point_cloud import Body

from ..limits.asker import Asker
from .query import BodyFormat, EncodedAnswer, Query


@dataclass(frozen=True)
class Look:
    """A look at a scan.

    Attributes:
        caller_name: of who looks: whose turn it takes, with the map.
        work: gets this look and the body without its content encoding, and returns the bytes of the answer.
            A worker process imports it by name, so it belongs to a module that needs no web framework.
        map_id: whose version is needed; empty: none is.
        version: of the map, or its first characters.
        body: as it came, with its content encoding. The last two are filled in by ``LocalizeUseCase``.
        directory: of the version's files.
    """

    caller_name: str
    body_format: BodyFormat
    work: Callable[[Look, Body], bytes]
    map_id: str = ""
    version: str | None = None
    body: Body = b""
    directory: Path | None = None
    deadline: ClassVar[float] = math.inf

    @property
    def asker(self) -> Asker:
        """The one whose turn it takes."""
        return Asker(self.caller_name, self.map_id)

    def filled(self, **more: Any) -> Look:
        """The look with what is filled in later, as ``Query.filled``."""
        return replace(self, **more)

    def answer(self, max_decoded_bytes: int) -> bytes:
        """The bytes of the answer.

        Raises:
            InputError: the body cannot be used.
        """
        return self.work(self, self.body_format.decompress(self.body, max_decoded_bytes))

    def __getstate__(self) -> dict[str, object]:
        """The part of the look that a worker process needs beside the body."""
        return {**self.__dict__, "body": b""}


Asked = Query | Look
# Of a query; of one whose maps are still to be chosen; of a look.
Answered = EncodedAnswer | SoughtScan | bytes
