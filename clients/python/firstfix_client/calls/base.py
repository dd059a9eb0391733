"""Bases of the groups of calls."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..drivers.async_http import AsyncHttp
    from ..drivers.blocking_service import BlockingService
    from ..steps.http import HttpSteps


class HttpCalls(ABC):
    """Base of the groups of blocking calls."""

    @property
    @abstractmethod
    def _http(self) -> BlockingService:
        """The service over HTTP.

        Raises:
            InvalidOption: this client has no URL.
        """


class AsyncCalls:
    """Base of the groups of asynchronous calls: the steps of every call, and their driver."""

    _steps: HttpSteps
    _http: AsyncHttp
