"""The gate of all HTTP routes: the caller, its permission and its rate limit; and the read-only mode.

A route that is missing in the table needs ``admin``: a forgotten entry closes a route, never opens it.
"""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import Depends, Request

from firstfix.access.permissions import Scope
from firstfix.errors import NotFound, ReadOnly, Unauthorized

from ..auth.permission import Permission
from ..auth.principal import Needs, Principal
from ..http_server.client_address import address_of
from ..settings import Settings
from ..thread_pools import AUTH
from .parts import parts_of

PUBLIC = None
_READING = frozenset({"GET", "HEAD", "OPTIONS"})
# By route name, which is the name of its function.
SCOPES: dict[str, Scope | None] = {
    "healthz": PUBLIC,
    "readyz": PUBLIC,
    "openapi": PUBLIC,
    "show_console": PUBLIC,
    "get_console_file": PUBLIC,
    "metrics": Scope.METRICS,
    "localize": Scope.LOCALIZE,
    "get_maps": Scope.LOCALIZE,
    "get_map": Scope.LOCALIZE,
    "get_versions": Scope.LOCALIZE,
    "get_version": Scope.LOCALIZE,
    "get_report": Scope.LOCALIZE,
    "get_picture": Scope.LOCALIZE,
    "get_cloud": Scope.LOCALIZE,
    "post_overlay": Scope.LOCALIZE,
    "get_cloud_points": Scope.LOCALIZE,
    "get_caller": Scope.LOCALIZE,
    "get_sensors": Scope.LOCALIZE,
    "get_georeference": Scope.LOCALIZE,
    "get_changes": Scope.LOCALIZE,
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
    "get_answer_events": Scope.BUILD,
    "get_samples": Scope.BUILD,
    "get_sample": Scope.BUILD,
    "get_sample_body": Scope.BUILD,
    "put_truth": Scope.BUILD,
    "delete_truth": Scope.BUILD,
    "delete_sample": Scope.ADMIN,
    "retire": Scope.ADMIN,
    "delete_map": Scope.ADMIN,
    "get_keys": Scope.ADMIN,
    "post_key": Scope.ADMIN,
    "delete_key": Scope.ADMIN,
    "collect_garbage_of_map": Scope.ADMIN,
    "collect_all_garbage": Scope.ADMIN,
}
# Rate limits of routes. Reads of much data count as queries do.
LIMITED: dict[str, Any] = {
    "localize": "localize",
    "post_overlay": "localize",
    "get_cloud": "localize",
    "get_cloud_points": "localize",
    "get_picture": "localize",
    "get_changes": "localize",
    "get_samples": "localize",
    "get_sample_body": "localize",
    "post_map": "build",
    "activate": "change",
    "roll_back": "change",
    "retire": "change",
    "delete_map": "change",
    "post_key": "change",
    "delete_key": "change",
    "put_georeference": "change",
    "delete_georeference": "change",
}


async def authorize(request: Request) -> None:
    """Lets a request pass, or refuses it. A dependency of every route.

    Stores the ``Principal`` in ``request.state.caller`` and the ``Permission``, for later checks, in
    ``request.state.permission``. Checks the map or build in the path. Routes check the maps in a body or in
    query parameters.

    Raises:
        Unauthorized, Forbidden, RateLimited: the request is refused.
        NotFound: the build belongs to a map that the caller may not see.
    """
    name = getattr(request.scope.get("route"), "name", "")
    scope = SCOPES.get(name, Scope.ADMIN)
    settings: Settings = request.app.state.settings
    if scope is PUBLIC or (name == "metrics" and (settings.metrics_public or settings.auth != "on")):
        return  # also before the store has answered
    parts = await parts_of(request)
    credential, address = _credential(request), address_of(request, settings.trusted_proxies)
    map_id, needs = request.path_params.get("map_id"), Needs(scope, LIMITED.get(name, ""))
    caller = await parts.authenticator.authorize(credential, address, needs, map_id)
    request.state.caller = caller
    request.state.permission = Permission(parts.authenticator, credential, address, scope, map_id)
    if (build_id := request.path_params.get("build_id")) is not None and not caller.sees_every_map:
        status = await AUTH.run(parts.catalog.shown_status, build_id)
        if not caller.sees(status["map_id"]):
            raise NotFound(f"no build {build_id}")


async def refuse_changes(request: Request) -> None:
    """Refuses changes in read-only mode, before the body is read. A dependency of the routes of the store.

    The store, which is opened read-only, refuses changes too.

    Raises:
        ReadOnly: the request would change something.
    """
    settings: Settings = request.app.state.settings
    if settings.read_only and request.method not in _READING:
        raise ReadOnly("this service is read-only (FIRSTFIX_READ_ONLY): use one that is not")


async def caller_of(request: Request) -> Principal:
    """Returns the caller of an authorized request."""
    caller: Principal = request.state.caller
    return caller


CallerDep = Annotated[Principal, Depends(caller_of)]


def _credential(request: Request) -> str | None:
    """The credential in the header; None without the header. URLs end up in logs, so none is read there.

    Raises:
        Unauthorized: the header is malformed.
    """
    given = request.headers.getlist("authorization")
    if not given:
        return None
    scheme, _, credential = given[0].partition(" ")
    if len(given) > 1 or scheme.lower() != "bearer" or not credential.strip():
        raise Unauthorized("a credential comes in one header Authorization, after the word Bearer")
    return credential.strip()
