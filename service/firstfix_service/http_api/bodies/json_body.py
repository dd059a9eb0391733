"""JSON objects in request bodies: of bounded size, without NaN and infinity."""

from __future__ import annotations

import json
import math
from typing import Any, NoReturn, TypeVar

from fastapi import Request
from pydantic import BaseModel, ValidationError

from firstfix.errors import InvalidOption, MalformedData

from ...limits.byte_budget import ByteBudget
from ...limits.limits import Limits
from .request_body import BodyReader

Model = TypeVar("Model", bound=BaseModel)


async def read_object(request: Request) -> dict[str, Any]:
    """The JSON object in a request's body.

    Raises:
        TooLarge: over ``Limits.max_json_bytes``.
        DeadlineExceeded: it did not arrive in time.
        MalformedData: as ``parse_object``.
    """
    most = Limits.max_json_bytes
    reader = BodyReader(most, ByteBudget.of_bodies(most), Limits.body_timeout_s)
    return parse_object(bytes(await reader.read(request)), "the body")


async def read_model(request: Request, model: type[Model]) -> Model:
    """The body as a model.

    Raises:
        InvalidOption: names each wrong field and the reason.
        TooLarge, DeadlineExceeded, MalformedData: as ``read_object``.
    """
    data = await read_object(request)
    try:
        return model.model_validate(data)
    except ValidationError as error:
        problems = (
            f"{'.'.join(str(part) for part in problem['loc']) or 'the body'}: {problem['msg']}"
            for problem in error.errors()
        )
        raise InvalidOption("; ".join(problems)) from None


def parse_object(data: bytes, what: str) -> dict[str, Any]:
    """A JSON object.

    Args:
        what: name of the data, for error messages.

    Raises:
        MalformedData: not JSON, not an object, or with NaN or infinite numbers.
    """
    try:
        value = json.loads(data, parse_constant=_refuse, parse_float=_finite)
    except (ValueError, RecursionError):
        raise MalformedData(f"{what} is not JSON") from None
    if not isinstance(value, dict):
        raise MalformedData(f"{what} is not a JSON object")
    return value


def _refuse(name: str) -> NoReturn:
    raise ValueError(f"{name} is not JSON")


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text[:40]} is out of range")
    return value
