"""Who asks, and what that caller may do."""

from __future__ import annotations

from dataclasses import dataclass

from firstfix.access.permissions import Grant, Scope
from firstfix.errors import Forbidden

EVERYTHING = Grant(frozenset({Scope.ADMIN}))


@dataclass(frozen=True)
class Caller:
    """
    Attributes:
        name: for logs, limits and as owner of what is handed in: ``key:<key id>``, ``jwt:<subject>`` or
            ``address:<address>``. No two callers share one.
        grant: what the credential allows; everything, where nobody is asked for one.
    """

    name: str
    grant: Grant = EVERYTHING

    def check(self, scope: Scope, map_id: str | None = None) -> None:
        """
        Args:
            map_id: that it is about, if it is about one.

        Raises:
            Forbidden: the scope is missing, or the map is not one of the caller's. The same whether there
                is such a map.
        """
        if not self.grant.allows(scope):
            raise Forbidden(f"this needs the scope {scope.value}")
        if map_id is not None:
            self.check_map(map_id)

    def check_map(self, map_id: str) -> None:
        """Checks that the map is one of the caller's.

        Raises:
            Forbidden: it is not. The same whether there is such a map.
        """
        if not self.sees(map_id):
            raise Forbidden(f"not allowed for map {map_id[:80]!r}")

    @property
    def repeats_as(self) -> str:
        """The name under which repeated requests belong together. Where nobody is asked for a credential it
        is one for all, as the address of a robot can change between two tries."""
        return NOBODY_ASKED.name if self.name.startswith("address:") else self.name

    def owns(self, owner: str | None) -> bool:
        """Whether the caller may use what the owner handed in: its own, and with ``admin`` everybody's.

        Args:
            owner: None: it was handed in to a release that did not record callers, and is everybody's.
        """
        return owner in (None, self.name) or self.grant.allows(Scope.ADMIN)

    @property
    def sees_every_map(self) -> bool:
        return "*" in self.grant.maps

    def sees(self, map_id: str) -> bool:
        """Whether the map is one of the caller's."""
        return self.grant.covers(map_id)


NOBODY_ASKED = Caller("anybody")  # a caller of the use case itself, behind no transport
