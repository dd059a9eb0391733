"""A successful answer, the same for all transports."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

from firstfix.errors import FirstfixError

T = TypeVar("T")


@dataclass(frozen=True)
class Answer:
    """Successful answer to a request.

    Attributes:
        source: the URL or key that was asked.
        body: empty for an answer that is read line by line.
    """

    source: str
    body: bytes

    def parsed(self, parse: Callable[[Any], T]) -> T:
        """Returns the answer's JSON, read by ``parse``.

        Raises:
            FirstfixError: it does not follow the protocol: another service, or a proxy's page.
        """
        try:
            return parse(json.loads(self.body))
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError) as error:
            raise FirstfixError(
                f"{self.source} sent an answer that this client cannot read: {error!r}"
            ) from None
