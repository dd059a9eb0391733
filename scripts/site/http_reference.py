"""The HTTP endpoints, from the OpenAPI document."""

from __future__ import annotations

import json
from typing import Any

_METHODS = ("get", "head", "post", "put", "patch", "delete", "options")


def http_reference(document: dict[str, Any]) -> str:
    """The endpoints and schemas as Markdown."""
    by_tag: dict[str, list[str]] = {}
    for path, operations in document["paths"].items():
        for method in _METHODS:
            if method in operations:
                operation = operations[method]
                by_tag.setdefault(operation["tags"][0], []).append(_operation(method, path, operation))
    parts: list[str] = []
    for tag in sorted(by_tag):
        parts += [f"## {tag.capitalize()}", *by_tag[tag]]
    parts.append("## Schemas")
    parts += [_schema(name, schema) for name, schema in sorted(document["components"]["schemas"].items())]
    return "\n\n".join(parts) + "\n"


def _operation(method: str, path: str, operation: dict[str, Any]) -> str:
    parts = [f"### `{method.upper()} {path}`", operation.get("description", "")]
    if parameters := operation.get("parameters"):
        rows = [
            [
                f"`{p['name']}`",
                p["in"],
                _type(p["schema"]),
                "yes" if p.get("required") else "no",
                _described(p),
            ]
            for p in parameters
        ]
        parts.append(_table(["parameter", "in", "type", "required", "meaning"], rows))
    if body := operation.get("requestBody"):
        rows = [
            [f"`{media}`", _type(content.get("schema", {}))] for media, content in body["content"].items()
        ]
        parts.append(_table(["body", "type"], rows))
    parts.append(_table(["answer", "media type", "type", "meaning"], _answers(operation["responses"])))
    return "\n\n".join(part for part in parts if part)


def _answers(responses: dict[str, Any]) -> list[list[str]]:
    rows = []
    for status, response in responses.items():
        if status == "default":
            continue  # the problem document, which every endpoint has
        contents = response.get("content") or {"": {}}
        for media, content in contents.items():
            rows.append(
                [
                    status,
                    f"`{media}`" if media else "",
                    _type(content.get("schema", {})),
                    _described(response),
                ]
            )
    return rows


def _schema(name: str, schema: dict[str, Any]) -> str:
    parts = [f"### {name}", schema.get("description", "")]
    required = set(schema.get("required", ()))
    if properties := schema.get("properties"):
        rows = [
            [f"`{field}`", _type(value), "yes" if field in required else _default(value), _described(value)]
            for field, value in properties.items()
        ]
        parts.append(_table(["field", "type", "required, or default", "meaning"], rows))
    else:
        parts.append(_type(schema))
    return "\n\n".join(part for part in parts if part)


def _type(schema: dict[str, Any]) -> str:
    if "$ref" in schema:
        name = schema["$ref"].rsplit("/", 1)[1]
        return f"[{name}](#{name.lower()})"
    for key in ("anyOf", "oneOf"):
        if key in schema:
            return " or ".join(_type(option) for option in schema[key])
    if "enum" in schema:
        return ", ".join(f"`{value}`" for value in schema["enum"])
    if "const" in schema:
        return f"`{schema['const']}`"
    if schema.get("type") == "array":
        return f"list of {_type(schema.get('items', {})) or 'values'}"
    limits = [
        f"{sign} {schema[key]}"
        for key, sign in (
            ("minimum", "≥"),
            ("exclusiveMinimum", "\\>"),
            ("maximum", "≤"),
            ("exclusiveMaximum", "\\<"),
        )
        if key in schema
    ]
    kind = "bytes" if schema.get("format") == "binary" else str(schema.get("type", ""))
    return f"{kind} ({', '.join(limits)})" if limits else kind


def _default(schema: dict[str, Any]) -> str:
    return f"`{json.dumps(schema['default'])}`" if "default" in schema else "no"


def _described(item: dict[str, Any]) -> str:
    return " ".join(item.get("description", "").split()).replace("|", "\\|")


def _table(head: list[str], rows: list[list[str]]) -> str:
    lines = ["| " + " | ".join(row) + " |" for row in [head, ["---"] * len(head), *rows]]
    return "\n".join(lines)
