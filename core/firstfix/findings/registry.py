"""All kinds of findings by code, as the documents' tables list them."""

from __future__ import annotations

from types import ModuleType

from . import map_kinds, scan_kinds
from .kind import FindingKind


def kinds_of(module: ModuleType) -> tuple[FindingKind, ...]:
    """The kinds that a module defines, in its order."""
    return tuple(one for one in vars(module).values() if isinstance(one, FindingKind))


KINDS = {kind.code: kind for module in (scan_kinds, map_kinds) for kind in kinds_of(module)}
