"""HTTP calls of a blocking client."""

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
    """A service over HTTP: the steps of its calls, and their blocking driver.

    Attributes:
        steps: all calls, to be passed to ``run`` or ``items``.
    """

    def __init__(
        self, steps: HttpSteps, headers: Mapping[str, str], transport: httpx.BaseTransport | None
    ) -> None:
        self.steps = steps
        self._http = BlockingHttp(headers, transport)

    def run(self, steps: Steps[T]) -> T:
        """Performs a call and returns its result."""
        return blocking.run(steps, self._http.ask)

    def items(self, steps: Steps[None]) -> Iterator[Any]:
        """Performs a call and yields its items."""
        return blocking.iterate(steps, self._http.ask)

    def close(self) -> None:
        """Closes the connections."""
        self._http.close()
