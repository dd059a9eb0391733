"""Path and query parameters that several routes share. The core checks the ids; here they are described."""

from __future__ import annotations

from typing import Annotated

from fastapi import Path, Query

_NAME = {"pattern": "^[a-z0-9][a-z0-9_-]{0,62}$"}

MapId = Annotated[
    str,
    Path(description="id of the map", json_schema_extra=_NAME, examples=["hall"]),
]
BuildId = Annotated[str, Path(description="id of the build", json_schema_extra=_NAME)]
UploadId = Annotated[str, Path(description="id of the upload", json_schema_extra=_NAME)]
KeyId = Annotated[str, Path(description="id of the key", json_schema_extra={"pattern": "^[0-9a-f]{12}$"})]
QueryId = Annotated[
    str,
    Path(
        description="id of the recorded query",
        json_schema_extra={"pattern": "^[0-9]{8}t[0-9]{12}-[0-9a-f]{8}$"},
    ),
]
Version = Annotated[
    str, Path(description="digest of the version", json_schema_extra={"pattern": "^[0-9a-f]{64}$"})
]

DEFAULT_LIMIT = 100  # entries of one page
MAX_LIMIT = 1000
Limit = Annotated[int, Query(ge=1, le=MAX_LIMIT, description="limit of the entries on this page")]
After = Annotated[
    str | None, Query(max_length=200, description="`next` of the previous page; none for the first page")
]
