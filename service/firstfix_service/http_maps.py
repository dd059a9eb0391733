"""/maps: hand a map in, see what is there, choose the version that answers."""

from __future__ import annotations

import asyncio
import json
import shutil
import uuid
from datetime import datetime, timezone
from typing import Any

from fastapi import APIRouter, Request, Response
from fastapi.responses import JSONResponse

from firstfix.build_records import new_status
from firstfix.catalog import source_key
from firstfix.errors import InvalidOption, MalformedData, NotFound, UnsupportedFormat
from firstfix.grant import Scope
from firstfix.ids import check_map_id

from .authorize import CallerDep
from .caller import Caller
from .parts import Parts, PartsDep
from .request_body import BodyReader
from .request_scope import with_traceparent
from .source_policy import check_source_url
from .upload import MAX_TEXT_BYTES, UploadedFile, harmless_name, receive_form

router = APIRouter(prefix="/maps", tags=["maps"])
RETRY_AFTER_S = 2
JSON_TIMEOUT_S = 30.0
_TEXTS, _FILES = {"map_id", "config"}, {"source", "trajectory"}
_NAMED_URL = {"type": "object", "required": ["url"], "properties": {"url": {"type": "string"}}}
_BODY: dict[str, Any] = {
    "requestBody": {
        "required": True,
        "content": {
            "multipart/form-data": {
                "schema": {
                    "type": "object",
                    "required": ["map_id", "source"],
                    "properties": {
                        "map_id": {"type": "string"},
                        "source": {"type": "string", "format": "binary"},
                        "trajectory": {"type": "string", "format": "binary"},
                        "config": {"type": "string", "description": "the build's config as JSON"},
                    },
                }
            },
            "application/json": {
                "schema": {
                    "type": "object",
                    "required": ["map_id", "source"],
                    "properties": {
                        "map_id": {"type": "string"},
                        "source": _NAMED_URL,
                        "trajectory": _NAMED_URL,
                        "config": {"type": "object"},
                    },
                }
            },
        },
    }
}


@router.post("", status_code=202, openapi_extra=_BODY)
async def post_map(request: Request, parts: PartsDep, caller: CallerDep) -> Response:
    """Hands in a map: it is built into a new version, which then becomes the active one."""
    media_type = request.headers.get("content-type", "").split(";", 1)[0].strip().lower()
    if media_type == "multipart/form-data":
        record = await _from_form(request, parts, caller)
    elif media_type == "application/json":
        record = await _from_json(request, parts, caller)
    else:
        raise UnsupportedFormat("POST /maps takes multipart/form-data or application/json")
    # The time first, so that builds sort by age.
    build_id = f"{datetime.now(timezone.utc):%Y%m%dt%H%M%S%f}-{uuid.uuid4().hex[:8]}"
    await asyncio.to_thread(parts.catalog.put_build, build_id, with_traceparent(record))
    if parts.builds is not None:
        await parts.builds.submit(build_id)
    status = new_status("queued", map_id=record["map_id"])
    headers = {"Location": f"/builds/{build_id}", "Retry-After": str(RETRY_AFTER_S)}
    return JSONResponse({"build_id": build_id, **status}, 202, headers)


@router.get("")
def get_maps(parts: PartsDep, caller: CallerDep) -> dict[str, Any]:
    """The caller's maps that have a version to serve."""
    ids = [map_id for map_id in parts.catalog.map_ids() if caller.sees(map_id)]
    return {
        "maps": [{"map_id": map_id, "active_version": parts.catalog.active_version(map_id)} for map_id in ids]
    }


@router.get("/{map_id}")
def get_map(map_id: str, parts: PartsDep) -> dict[str, Any]:
    """One map, with what the manifest of its active version says."""
    state = parts.catalog.state(map_id)
    if not state.entries:
        raise NotFound(f"no map {map_id}")
    described: dict[str, Any] = {
        "map_id": map_id,
        "active_version": state.active,
        "versions": len(state.published),
    }
    if state.active is not None:
        described["manifest"] = parts.catalog.manifest(map_id, state.active).to_mapping()
    return described


@router.get("/{map_id}/versions")
def get_versions(map_id: str, parts: PartsDep) -> dict[str, Any]:
    """The map's versions that can be served, newest first."""
    return {
        "map_id": map_id,
        "versions": [
            {"version": info.version, "active": info.active, "published_time": info.published_time}
            for info in parts.catalog.versions(map_id)
        ],
    }


@router.post("/{map_id}/versions/{version}/activate")
def activate(map_id: str, version: str, parts: PartsDep) -> dict[str, Any]:
    """Lets a published version answer from now on: back or forward. This replica follows before it
    answers, others within their poll interval."""
    parts.catalog.activate(map_id, version)
    serving = parts.maps.refresh(map_id).version
    return {"map_id": map_id, "active_version": version, "serving_version": serving}


async def _from_form(request: Request, parts: Parts, caller: Caller) -> dict[str, Any]:
    """The build request of an upload, its files in the store."""
    directory = parts.settings.work_dir / "uploads" / uuid.uuid4().hex
    directory.mkdir(parents=True)
    try:
        form = await receive_form(
            request,
            directory,
            text_fields=_TEXTS,
            file_fields=_FILES,
            max_bytes=parts.settings.max_upload_bytes,
        )
        map_id = check_map_id(form.texts.get("map_id", ""))
        caller.check(Scope.BUILD, map_id)
        config = _config(form.texts.get("config") or "{}")
        if "source" not in form.files:
            raise InvalidOption("the form has no file 'source'")
        source = form.files["source"]
        trajectory = form.files.get("trajectory")
        return {
            "map_id": map_id,
            "source": {"key": await _keep(parts, map_id, source)},
            "file_name": source.file_name,
            "trajectory": trajectory
            and {"key": await _keep(parts, map_id, trajectory), "file_name": trajectory.file_name},
            "config": config,
        }
    finally:
        await asyncio.to_thread(shutil.rmtree, directory, ignore_errors=True)


async def _keep(parts: Parts, map_id: str, file: UploadedFile) -> str:
    sha256 = await asyncio.to_thread(parts.catalog.put_source, map_id, file.path)
    return source_key(map_id, sha256)


async def _from_json(request: Request, parts: Parts, caller: Caller) -> dict[str, Any]:
    """The build request of a body that names URLs."""
    body = _object(await BodyReader(MAX_TEXT_BYTES, MAX_TEXT_BYTES, JSON_TIMEOUT_S).read(request), "the body")
    unknown = set(body) - {"map_id", "source", "trajectory", "config"}
    if unknown:
        raise InvalidOption(f"no field {', '.join(sorted(unknown))[:200]}")
    map_id = check_map_id(str(body.get("map_id", "")))
    caller.check(Scope.BUILD, map_id)
    source = _url(parts, body.get("source"), "source")
    trajectory = None
    if body.get("trajectory") is not None:
        url = _url(parts, body["trajectory"], "trajectory")
        trajectory = {"url": url, "file_name": _ending(url)}
    config = body.get("config") or {}
    if not isinstance(config, dict):
        raise InvalidOption("config is a JSON object")
    return {
        "map_id": map_id,
        "source": {"url": source},
        "file_name": _ending(source),
        "trajectory": trajectory,
        "config": config,
    }


def _url(parts: Parts, named: Any, role: str) -> str:
    if not isinstance(named, dict) or set(named) != {"url"} or not isinstance(named["url"], str):
        raise InvalidOption(f'{role} is {{"url": "..."}}')
    return check_source_url(named["url"], parts.settings.source_urls)


def _ending(url: str) -> str:
    return harmless_name(url.split("?", 1)[0])


def _config(text: str) -> dict[str, Any]:
    return _object(text.encode(), "config")


def _object(data: bytes, what: str) -> dict[str, Any]:
    try:
        value = json.loads(data)
    except (ValueError, RecursionError):
        raise MalformedData(f"{what} is not JSON") from None
    if not isinstance(value, dict):
        raise MalformedData(f"{what} is no JSON object")
    return value
