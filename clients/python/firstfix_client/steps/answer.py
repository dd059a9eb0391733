"""A successful answer, of whichever transport."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

from firstfix.errors import FirstfixError

T = TypeVar("T")


@dataclass(frozen=True)
class Answer:
    """
    Attributes:
        source: the URL or key that was asked.
        body: empty where the lines of the answer come one by one.
    """

    source: str
    body: bytes

    def parsed(self, parse: Callable[[Any], T]) -> T:
        """What the answer's JSON says.

        Raises:
            FirstfixError: it is not what the protocol says: another service, or a proxy's page.
        """
        try:
            return parse(json.loads(self.body))
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise FirstfixError(f"{self.source} answered nothing this client can read: {error!r}") from None
