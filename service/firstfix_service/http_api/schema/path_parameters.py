"""The parts of paths that name things. Their form is checked by the core; here it is described."""

from __future__ import annotations

from typing import Annotated

from fastapi import Path

_NAME = {"pattern": "^[a-z0-9][a-z0-9_-]{0,62}$"}

MapId = Annotated[
    str,
    Path(description="id of the map", json_schema_extra=_NAME, examples=["hall"]),
]
BuildId = Annotated[str, Path(description="id of the build", json_schema_extra=_NAME)]
UploadId = Annotated[str, Path(description="id of the upload", json_schema_extra=_NAME)]
Version = Annotated[
    str, Path(description="digest of the version", json_schema_extra={"pattern": "^[0-9a-f]{64}$"})
]
