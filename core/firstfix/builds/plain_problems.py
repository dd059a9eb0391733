"""Faults of a config or of settings, in the words of firstfix and not in those of pydantic."""

from __future__ import annotations

from pydantic import ValidationError

_WORDS = {
    "missing": "it must be given",
    "extra_forbidden": "there is no such option",
    "greater_than": "it must be greater than {gt}",
    "greater_than_equal": "it must be at least {ge}",
    "less_than": "it must be less than {lt}",
    "less_than_equal": "it must be at most {le}",
    "literal_error": "it must be {expected}",
}


def plain_problems(error: ValidationError) -> str:
    """One line about all problems, each after the name of its value."""
    told = []
    for problem in error.errors():
        name = ".".join(str(part) for part in problem["loc"])
        words = _WORDS.get(problem["type"])
        plain = problem["msg"].removeprefix("Value error, ")
        told.append(f"{name}: {plain if words is None else words.format(**problem.get('ctx', {}))}")
    return "; ".join(told)
