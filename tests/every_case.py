"""Many small cases in one test: all of them run, and the test names those that fail."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Sequence
from functools import wraps
from typing import Any

import pytest

Test = Callable[..., None]


def every_case(
    names: str | Sequence[str],
    cases: Iterable[Any],
    *,
    ids: Callable[[Any], str] | Sequence[str] | None = None,
) -> Callable[[Test], Test]:
    """Runs a test for every case, like ``pytest.mark.parametrize``, but as one test.

    For cases of about a millisecond: pytest needs longer than that for a test. All cases share the fixtures.

    Args:
        names: parameters of the test; several with commas or as a tuple.
        cases: the value of the parameter, or a tuple of values.
        ids: names of the cases, or a function that names one. Default: their values.
    """
    parameters = [name.strip() for name in names.split(",")] if isinstance(names, str) else list(names)
    rows = [case if len(parameters) > 1 else (case,) for case in cases]
    labels = list(ids) if ids is not None and not callable(ids) else [_label(row, ids) for row in rows]
    assert rows, "there are no cases"

    def decorate(test: Test) -> Test:
        @wraps(test)
        def run(**fixtures: Any) -> None:
            failures = []
            for label, row in zip(labels, rows, strict=True):
                try:
                    test(**fixtures, **dict(zip(parameters, row, strict=True)))
                except (Exception, pytest.fail.Exception) as error:
                    failures.append(f"[{label}] {type(error).__name__}: {error}")
            assert not failures, f"{len(failures)} of {len(rows)} cases failed:\n" + "\n".join(failures)

        signature = inspect.signature(test)
        kept = [one for name, one in signature.parameters.items() if name not in parameters]
        run.__signature__ = signature.replace(parameters=kept)  # type: ignore[attr-defined]
        return run

    return decorate


def _label(row: Sequence[Any], name: Callable[[Any], str] | None) -> str:
    return ", ".join(name(value) if name is not None else repr(value)[:60] for value in row)
