"""Bodies in the OpenAPI document that routes read themselves, so that no signature names them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from pydantic import BaseModel

BINARY = {"schema": {"type": "string", "format": "binary"}}
SCHEMAS: dict[str, Any] = {}  # of the models of such bodies


def json_body(model: type[BaseModel]) -> dict[str, Any]:
    """Description of an operation whose body is this model, in JSON."""
    return _body({"application/json": {"schema": {"$ref": add_schema(model)}}})


def binary_body(media_types: Iterable[str]) -> dict[str, Any]:
    """Description of an operation whose body is bytes of one of these types."""
    return _body(dict.fromkeys(media_types, BINARY))


def binary_answer(media_type: str) -> dict[int | str, dict[str, Any]]:
    """Description of an answer of bytes."""
    return {200: {"content": {media_type: BINARY}}}


def add_schema(model: type[BaseModel]) -> str:
    """Add a model to the document, and return the reference to it."""
    schema = model.model_json_schema(ref_template="#/components/schemas/{model}")
    SCHEMAS.update({**schema.pop("$defs", {}), model.__name__: schema})
    return f"#/components/schemas/{model.__name__}"


def _body(content: dict[str, Any]) -> dict[str, Any]:
    return {"requestBody": {"required": True, "content": content}}
