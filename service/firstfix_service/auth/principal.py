"""Principal of a request: the caller's name, and what it may do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

from firstfix.access.permissions import Grant, Scope
from firstfix.catalog.provenance import Provenance
from firstfix.errors import Forbidden

EVERYTHING = Grant(frozenset({Scope.ADMIN}))


Rate = Literal["", "localize", "build", "change"]


class Needs(NamedTuple):
    """Needs of a request.

    Attributes:
        rate: name of the limit that it counts against. A change counts for its map, because each one is an
            entry in that map's log.
        has_queue: requests wait for their turn in a queue of their own. Otherwise each takes from the credit
            of its caller; of these only refusals do.
    """

    scope: Scope
    rate: Rate = ""
    has_queue: bool = False


@dataclass(frozen=True)
class Principal:
    """A caller and its permissions.

    Attributes:
        name: for logs, limits and ownership: ``key:<key id>``, ``jwt:<subject>`` or ``address:<address>``. It
            is unique to the caller.
        grant: the permissions of the credential; everything if authentication is off.
        key_name: that its API key has for people; empty: it has none.
    """

    name: str
    grant: Grant = EVERYTHING
    key_name: str = ""

    def check(self, scope: Scope, map_id: str | None = None) -> None:
        """Check the permission for a request.

        Args:
            map_id: the map that the request is about, if any.

        Raises:
            Forbidden: the scope is missing, or the map is not one of the caller's. The error is the same
                whether or not the map exists.
        """
        if not self.grant.allows(scope):
            raise Forbidden(f"this needs the scope {scope.value}")
        if map_id is not None:
            self.check_map(map_id)

    def check_map(self, map_id: str) -> None:
        """Check that the map is one of the caller's.

        Raises:
            Forbidden: it is not. The same whether there is such a map.
        """
        if not self.grant.covers(map_id):
            raise Forbidden(f"not allowed for map {map_id[:80]!r}")

    @property
    def has_credential(self) -> bool:
        """Whether more than an address tells the caller apart."""
        return not self.name.startswith("address:")

    @property
    def repeats_as(self) -> str:
        """Name under which repeated requests of this caller are recognised.

        If authentication is off it is the same for all callers, because a robot's address can change between
        two tries.
        """
        return self.name if self.has_credential else ANONYMOUS.name

    def owns(self, owner: str | None) -> bool:
        """Whether the caller may use an object: one of its own, or any with the scope ``admin``.

        Args:
            owner: the caller who made the object. None means that its record names no owner: everybody may
                use it.
        """
        return owner in (None, self.name) or self.grant.allows(Scope.ADMIN)

    def sees_who(self, provenance: Provenance) -> bool:
        """Whether the caller may see who made a version, and where: its own, or any with ``admin``."""
        return provenance.caller == self.name or self.grant.allows(Scope.ADMIN)

    @property
    def sees_every_map(self) -> bool:
        """True if no map is hidden from the caller."""
        return "*" in self.grant.maps

    def sees(self, map_id: str) -> bool:
        """Whether the map is one of the caller's."""
        return self.grant.covers(map_id)


ANONYMOUS = Principal("anybody")  # a caller without a transport, inside the process
