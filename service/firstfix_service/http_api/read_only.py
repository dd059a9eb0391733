"""A replica that was told to change nothing says so before it reads a body."""

from __future__ import annotations

from fastapi import Request

from firstfix.errors import ReadOnly

from ..settings import Settings

_READING = frozenset({"GET", "HEAD", "OPTIONS"})


async def refuse_changes(request: Request) -> None:
    """Dependency of the routes that work on the store. The store itself, opened read-only, refuses too.

    Raises:
        ReadOnly: the request would change something and this service is read-only.
    """
    settings: Settings = request.app.state.settings
    if settings.read_only and request.method not in _READING:
        raise ReadOnly("this service is read-only (FIRSTFIX_READ_ONLY): ask one that is not")
