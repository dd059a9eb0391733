"""/keys: the API keys of the store, for administrators of all maps."""

from __future__ import annotations

from datetime import timedelta
from typing import Any

from fastapi import APIRouter, Depends, Request

from firstfix.access.api_keys import ApiKeys
from firstfix.access.permissions import Grant
from firstfix.errors import Forbidden

from ...thread_pools import CHANGES, LISTS
from ..authorize import CallerDep
from ..bodies.json_body import read_model
from ..dependencies import Parts, PartsDep
from ..schema.key_models import Key, KeyList, NewKey, NewKeyBody
from ..schema.parameters import KeyId


async def _sees_every_map(caller: CallerDep) -> None:
    """Refuses an administrator of some maps: a key that it makes could open the others.

    Raises:
        Forbidden: a map is hidden from the caller.
    """
    if not caller.sees_every_map:
        raise Forbidden("keys are managed by those who may see every map")


router = APIRouter(prefix="/keys", tags=["keys"], dependencies=[Depends(_sees_every_map)])
_BODY: dict[str, Any] = {
    "requestBody": {
        "required": True,
        "content": {"application/json": {"schema": {"$ref": "#/components/schemas/NewKeyBody"}}},
    }
}


@router.get("")
@LISTS.route
def get_keys(parts: PartsDep) -> KeyList:
    """All keys, oldest first, without their secrets. `unreadable`: ids of keys whose records are damaged."""
    found, bad = ApiKeys(parts.catalog.store).all()
    return KeyList(keys=[Key.model_validate(key.to_mapping()) for key in found], unreadable=bad)


@router.post("", status_code=201, openapi_extra=_BODY)
async def post_key(request: Request, parts: PartsDep) -> NewKey:
    """Makes a key. Its token is in this answer alone: nobody can read it again."""
    body = await read_model(request, NewKeyBody)
    return await CHANGES.run(_create, parts, body)


@router.delete("/{key_id}", status_code=204)
@CHANGES.route
def delete_key(key_id: KeyId, parts: PartsDep) -> None:
    """Revokes a key for good. Replicas refuse it within 5 s."""
    ApiKeys(parts.catalog.store).revoke(key_id)


def _create(parts: Parts, body: NewKeyBody) -> NewKey:
    store, expires = parts.catalog.store, None
    if body.expires_in_days is not None:
        expires = store.now() + timedelta(days=body.expires_in_days)
    key, token = ApiKeys(store).create(body.name, Grant.parse(body.scopes, body.maps), expires)
    return NewKey.model_validate({**key.to_mapping(), "token": token})
