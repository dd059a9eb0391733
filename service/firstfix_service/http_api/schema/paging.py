"""Long lists in pages: each names where the next one begins."""

from __future__ import annotations

from typing import Annotated

from fastapi import Query

DEFAULT_LIMIT = 100
MAX_LIMIT = 1000

Limit = Annotated[int, Query(ge=1, le=MAX_LIMIT, description="how many at most")]
After = Annotated[
    str | None, Query(max_length=200, description="`next` of the page before; none for the first")
]
