"""Protocol of the one that answers a gateway's queries: a client of a service, or a localizer here."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, TypeVar, runtime_checkable

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.ids import is_robot_name
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


Asking = TypeVar("Asking", bound=Callable[..., Localization])


@runtime_checkable
class NamesRobots(Protocol):
    """Answerer that can tell a service which robot asks."""

    def of_robot(self, name: str) -> Any:
        """The answerer of one robot."""
        ...


def of_robot(ask: Asking, name: str) -> Asking:
    """The answerer of one robot of a fleet, which names it where somebody else answers.

    Args:
        name: its namespace or serial number. One that a service would not take is left out.
    """
    if not isinstance(ask, NamesRobots) or not is_robot_name(name):
        return ask
    named: Asking = ask.of_robot(name)
    return named
