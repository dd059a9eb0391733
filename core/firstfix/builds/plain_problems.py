"""What is wrong with a config or with settings, in the words of firstfix and not in those of pydantic."""

from __future__ import annotations

from pydantic import ValidationError

_WORDS = {"missing": "it must be given", "extra_forbidden": "there is no such option"}


def plain_problems(error: ValidationError) -> str:
    """Returns one line about all problems, each after the name of its value."""
    return "; ".join(
        f"{'.'.join(str(part) for part in problem['loc'])}: "
        + _WORDS.get(problem["type"], problem["msg"].removeprefix("Value error, "))
        for problem in error.errors()
    )
