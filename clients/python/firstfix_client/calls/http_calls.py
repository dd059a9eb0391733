"""What the groups of blocking calls stand on."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..drivers.blocking_service import BlockingService


class HttpCalls(ABC):
    @property
    @abstractmethod
    def _http(self) -> BlockingService:
        """
        Raises:
            InvalidOption: this client speaks no HTTP.
        """
