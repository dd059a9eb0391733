"""Models of API keys."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field
from pydantic.config import JsonDict

_EXAMPLE: JsonDict = {"name": "robot-7", "scopes": ["localize"], "maps": ["hall*"], "expires_in_days": 90}


class NewKeyBody(BaseModel):
    """An API key to be made."""

    model_config = ConfigDict(extra="forbid", json_schema_extra={"examples": [_EXAMPLE]})
    name: str = Field(max_length=100, description="for people")
    scopes: list[str] = Field(min_length=1, max_length=10, description="localize, build, metrics or admin")
    maps: list[str] = Field(["*"], description="patterns of map ids, with * and ?")
    expires_in_days: float | None = Field(None, gt=0, le=36500, description="null: it does not expire")


class Key(BaseModel):
    """An API key without its secret."""

    key_id: str
    name: str
    scopes: list[str]
    maps: list[str]
    created_time: str = Field(description="UTC, ISO 8601")
    expires_time: str | None = Field(description="UTC, ISO 8601; null: it does not expire")
    revoked: bool


class NewKey(Key):
    """An API key that was made just now."""

    token: str = Field(description="what the caller sends; it is shown only once")


class KeyList(BaseModel):
    """All API keys."""

    keys: list[Key] = Field(description="oldest first")
    unreadable: list[str] = Field(description="ids of keys whose records are damaged")
