"""A part of a deployment that can be frozen, and what is expected of the others meanwhile."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

LOCALIZE = ("localize a", "localize b", "zenoh")  # kinds of calls that need nothing but the service
BY_ROUTER = "zenoh by router"
OF_STORE = ("maps", "activate", "upload", "build")


@dataclass(frozen=True)
class Effect:
    """Calls that may fail while a part is frozen; all that are not named go on as before.

    Attributes:
        codes: outcomes that calls of a kind may have beside "ok", by kind. These calls may be slow too.
        lost: calls of ``LOCALIZE`` that may be slow or fail, of all together.
    """

    codes: Mapping[str, frozenset[str]] = field(default_factory=dict)
    lost: int = 0

    def __or__(self, other: Effect) -> Effect:
        kinds = self.codes.keys() | other.codes.keys()
        none: frozenset[str] = frozenset()
        both = {kind: self.codes.get(kind, none) | other.codes.get(kind, none) for kind in kinds}
        return Effect(both, self.lost + other.lost)


class Part(Protocol):
    """A part. ``start`` comes first, and again after ``kill``."""

    name: str
    effect: Effect

    def start(self) -> None:
        """When it is ready."""

    def freeze(self) -> None:
        """Stop it where it hurts: in the middle of its work."""

    def thaw(self) -> None:
        """Let it go on."""

    def kill(self) -> None:
        """End it, frozen or not."""
