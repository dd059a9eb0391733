"""Schema of the body of POST /maps. The service parses it itself, because it may have gigabytes."""

from __future__ import annotations

from typing import Any

from firstfix.builds.config import BuildConfig

IDEMPOTENCY_KEY_TEXT = (
    "makes the request safe to repeat for a day: the same key with the same request returns the first build, "
    "with another request 409 `idempotency_conflict`"
)
_CONFIG: dict[str, Any] = BuildConfig.model_json_schema(ref_template="#/components/schemas/{model}")
CONFIG_SCHEMAS: dict[str, Any] = {**_CONFIG.pop("$defs"), "BuildConfig": _CONFIG}
_NAMED = {
    "oneOf": [
        {
            "type": "object",
            "required": [kind],
            "additionalProperties": False,
            "properties": {kind: {"type": "string", "description": text}},
        }
        for kind, text in (
            ("url", "URL of a file below a prefix that the operator allows"),
            ("upload", "id of a complete upload"),
        )
    ]
}
_NOTE = {"type": "string", "maxLength": 500, "description": "for people: shown with the version"}
_MAP_ID = {"type": "string", "pattern": "^[a-z0-9][a-z0-9_-]{0,62}$"}
BODY: dict[str, Any] = {
    "requestBody": {
        "required": True,
        "content": {
            "multipart/form-data": {
                "schema": {
                    "type": "object",
                    "required": ["map_id", "source"],
                    "additionalProperties": False,
                    "properties": {
                        "map_id": _MAP_ID,
                        "source": {"type": "string", "format": "binary"},
                        "trajectory": {"type": "string", "format": "binary"},
                        "config": {
                            "type": "string",
                            "contentMediaType": "application/json",
                            "description": "a `BuildConfig`",
                        },
                        "note": _NOTE,
                    },
                }
            },
            "application/json": {
                "schema": {
                    "type": "object",
                    "required": ["map_id", "source"],
                    "additionalProperties": False,
                    "properties": {
                        "map_id": _MAP_ID,
                        "source": _NAMED,
                        "trajectory": {"anyOf": [_NAMED, {"type": "null"}]},
                        "config": {"$ref": "#/components/schemas/BuildConfig"},
                        "note": _NOTE,
                    },
                },
                "examples": {
                    "by URL": {
                        "value": {
                            "map_id": "hall",
                            "source": {"url": "s3://maps/hall.laz"},
                            "config": {"sensor": "os0-64"},
                        }
                    },
                    "by upload": {"value": {"map_id": "hall", "source": {"upload": "u3f6c"}}},
                },
            },
        },
    }
}
