"""Compares the result of a client with the expectation of a vector."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from firstfix.errors import FirstfixError

from .plain_form import plain_form
from .python_client import Vector, run

TOLERANCE = 1e-9  # of numbers computed through a rotation matrix
_UNREADABLE = (ValueError, KeyError, TypeError, AttributeError)


def difference(folder: Path, vector: Vector) -> str:
    """Returns the reason why the Python client fails the vector; empty if it passes."""
    expected = vector["expected"]
    try:
        got = run(folder, vector)
    except FirstfixError as error:
        return _of_errors(expected, error.code)
    except _UNREADABLE:
        return _of_errors(expected, "unreadable")
    if "error" in expected:
        return f"accepted, not refused as {expected['error']}"
    if "body" not in expected:
        return "" if alike(got, expected["value"]) else f"{got} instead of {expected['value']}"
    if plain_form(got) != plain_form((folder / expected["body"]).read_bytes()):
        return f"{len(got)} other bytes than {expected['body']}"
    return ""


def _of_errors(expected: Mapping[str, Any], code: str) -> str:
    return "" if code == expected.get("error") else f"refused as {code}"


def alike(got: Any, wanted: Any) -> bool:
    """Returns whether two values are equal.

    Numbers may differ by TOLERANCE, also comma-separated numbers in a text.
    """
    if isinstance(wanted, Mapping):
        return (
            isinstance(got, Mapping)
            and set(got) == set(wanted)
            and all(alike(got[k], wanted[k]) for k in wanted)
        )
    if isinstance(wanted, str):
        return got == wanted or (isinstance(got, str) and _close(_numbers(got), _numbers(wanted)))
    if isinstance(wanted, Sequence):
        return len(got) == len(wanted) and all(alike(g, w) for g, w in zip(got, wanted, strict=True))
    if isinstance(wanted, float) and isinstance(got, (int, float)):
        return math.isclose(got, wanted, rel_tol=0, abs_tol=TOLERANCE)
    return bool(got == wanted)


def _close(got: list[float] | None, wanted: list[float] | None) -> bool:
    return got is not None and wanted is not None and alike(got, wanted)


def _numbers(text: str) -> list[float] | None:
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        return None
