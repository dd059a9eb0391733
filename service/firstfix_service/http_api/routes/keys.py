"""/keys: the API keys of the store, for administrators of all maps."""

from __future__ import annotations

from datetime import timedelta

from fastapi import APIRouter, Depends, Request
from pydantic import BaseModel, ConfigDict, Field
from pydantic.config import JsonDict

from firstfix.access.api_keys import ApiKeys
from firstfix.access.permissions import Grant, Scope
from firstfix.errors import Forbidden
from firstfix.store.store import Store

from ...thread_pools import CHANGES, LISTS
from ..bodies.json_body import read_model
from ..edge import CallerDep, needs
from ..parts import CatalogDep
from ..schema.bodies import json_body
from ..schema.parameters import KeyId


async def _sees_every_map(caller: CallerDep) -> None:
    """Refuse an administrator of some maps: a key that it makes could open the others.

    Raises:
        Forbidden: a map is hidden from the caller.
    """
    if not caller.sees_every_map:
        raise Forbidden("keys are managed by those who may see every map")


router = APIRouter(prefix="/keys", tags=["keys"], dependencies=[Depends(_sees_every_map)])


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


@router.get("")
@needs(Scope.ADMIN)
@LISTS.route
def get_keys(catalog: CatalogDep) -> KeyList:
    """All keys, oldest first, without their secrets. `unreadable`: ids of keys whose records are damaged."""
    found, bad = ApiKeys(catalog.store).all()
    return KeyList(keys=[Key.model_validate(key.to_mapping()) for key in found], unreadable=bad)


@router.post("", status_code=201, openapi_extra=json_body(NewKeyBody))
@needs(Scope.ADMIN, "change")
async def post_key(request: Request, catalog: CatalogDep) -> NewKey:
    """Make a key. Its token is in this answer alone: nobody can read it again."""
    body = await read_model(request, NewKeyBody)
    return await CHANGES.run(_create, catalog.store, body)


@router.delete("/{key_id}", status_code=204)
@needs(Scope.ADMIN, "change")
@CHANGES.route
def delete_key(key_id: KeyId, catalog: CatalogDep) -> None:
    """Revokes a key for good. Replicas refuse it within 5 s."""
    ApiKeys(catalog.store).revoke(key_id)


def _create(store: Store, body: NewKeyBody) -> NewKey:
    expires = None
    if body.expires_in_days is not None:
        expires = store.now() + timedelta(days=body.expires_in_days)
    key, token = ApiKeys(store).create(body.name, Grant.parse(body.scopes, body.maps), expires)
    return NewKey.model_validate({**key.to_mapping(), "token": token})
