"""The calls over HTTP, performed for a caller that blocks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, TypeVar

import httpx

from ..steps.http import HttpSteps
from ..steps.step import Steps
from . import blocking
from .blocking_http import BlockingHttp

T = TypeVar("T")


class BlockingService:
    """
    Attributes:
        steps: to be run.
    """

    def __init__(
        self, steps: HttpSteps, headers: Mapping[str, str], transport: httpx.BaseTransport | None
    ) -> None:
        self.steps = steps
        self._http = BlockingHttp(headers, transport)

    def run(self, steps: Steps[T]) -> T:
        return blocking.run(steps, self._http.ask)

    def items(self, steps: Steps[None]) -> Iterator[Any]:
        return blocking.iterate(steps, self._http.ask)

    def close(self) -> None:
        self._http.close()
