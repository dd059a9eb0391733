"""Protocol of the one that answers a gateway's queries: a client of a service, or a localizer here."""

from __future__ import annotations

from typing import Protocol

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.scan.scan import Scan


class Answerer(Protocol):
    """Localizes one scan. It blocks until the answer is there, and is called by one thread of each robot."""

    def __call__(self, scan: Scan, options: LocalizeOptions, /) -> Localization:
        """The answer.

        Args:
            options: with gravity, prior and ``T_base_sensor`` where the robot knows them.

        Raises:
            FirstfixError, ConnectionError: no answer. The gateway reports it and tries again with a new scan.
        """
        ...
