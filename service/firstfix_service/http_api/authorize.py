"""The one gate of the HTTP routes: who asks, whether that caller may, and how often.

What is not in the table needs ``admin``: a route that somebody forgets to enter is shut, not open.
"""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends, Request

from firstfix.access.permissions import Scope
from firstfix.errors import NotFound, Unauthorized

from ..auth.permission import Permission
from ..auth.principal import Principal
from ..http_server.client_address import client_address
from ..lanes import AUTH
from ..settings import Settings
from ..telemetry.request_scope import note
from .dependencies import Parts, parts_of

PUBLIC = None
# By the name of a route, which is that of its function.
SCOPES: dict[str, Scope | None] = {
    "healthz": PUBLIC,
    "readyz": PUBLIC,
    "openapi": PUBLIC,
    "metrics": Scope.METRICS,
    "localize": Scope.LOCALIZE,
    "get_maps": Scope.LOCALIZE,
    "get_map": Scope.LOCALIZE,
    "get_versions": Scope.LOCALIZE,
    "get_version": Scope.LOCALIZE,
    "get_report": Scope.LOCALIZE,
    "get_picture": Scope.LOCALIZE,
    "get_georeference": Scope.LOCALIZE,
    "post_map": Scope.BUILD,
    "begin_upload": Scope.BUILD,
    "describe_uploads": Scope.BUILD,
    "get_upload": Scope.BUILD,
    "get_upload_offset": Scope.BUILD,
    "append_to_upload": Scope.BUILD,
    "delete_upload": Scope.BUILD,
    "activate": Scope.BUILD,
    "roll_back": Scope.BUILD,
    "put_georeference": Scope.BUILD,
    "delete_georeference": Scope.BUILD,
    "get_builds": Scope.BUILD,
    "get_build": Scope.BUILD,
    "get_build_events": Scope.BUILD,
    "cancel_build": Scope.BUILD,
    "retire": Scope.ADMIN,
    "collect_garbage_of_map": Scope.ADMIN,
    "collect_all_garbage": Scope.ADMIN,
}
# Routes whose requests are counted, as what.
LIMITED = {
    "localize": "localize",
    "post_map": "build",
    "activate": "change",
    "roll_back": "change",
    "retire": "change",
    "put_georeference": "change",
    "delete_georeference": "change",
}


async def authorize(request: Request) -> None:
    """A dependency of every route. Leaves the ``Principal`` in ``request.state.caller``, and the ``Permission``
    to be asked for again in ``request.state.permission``; where a map id stands in the path, or that of a
    build, the caller may go there. The map in a body or query is the route's to check.

    Raises:
        Unauthorized, Forbidden, RateLimited: as they say.
        NotFound: a build of a map that the caller may not see is like one that does not exist.
    """
    name = getattr(request.scope.get("route"), "name", "")
    scope = SCOPES.get(name, Scope.ADMIN)
    settings: Settings = request.app.state.settings
    if scope is PUBLIC or (name == "metrics" and (settings.metrics_public or settings.auth != "on")):
        return  # whether or not the store has answered yet
    parts = await parts_of(request)
    credential, address = _credential(request), _address(request, parts)
    caller = await parts.authenticator.authenticate(credential, address)
    request.state.caller = caller
    note(caller=caller.name)
    map_id = request.path_params.get("map_id")
    caller.check(scope, map_id)
    request.state.permission = Permission(parts.authenticator, credential, address, scope, map_id)
    if (build_id := request.path_params.get("build_id")) is not None and not caller.sees_every_map:
        status = await AUTH.run(parts.catalog.shown_status, build_id)
        if not caller.sees(status["map_id"]):
            raise NotFound(f"no build {build_id}")
    if name in LIMITED:
        parts.authenticator.take(LIMITED[name], caller, request.path_params.get("map_id", ""))


async def caller_of(request: Request) -> Principal:
    caller: Principal = request.state.caller
    return caller


CallerDep = Annotated[Principal, Depends(caller_of)]


def _credential(request: Request) -> str | None:
    """
    Raises:
        Unauthorized: the header is of another form. A credential in the URL is none: URLs end up in logs.
    """
    given = request.headers.getlist("authorization")
    if not given:
        return None
    scheme, _, credential = given[0].partition(" ")
    if len(given) > 1 or scheme.lower() != "bearer" or not credential.strip():
        raise Unauthorized("a credential comes in one header Authorization, after the word Bearer")
    return credential.strip()


def _address(request: Request, parts: Parts) -> str:
    peer = None if request.client is None else request.client.host
    forwarded = request.headers.getlist("x-forwarded-for")
    return client_address(peer, forwarded, parts.settings.trusted_proxies)
