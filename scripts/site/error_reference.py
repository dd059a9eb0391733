"""The error codes, from the tree of errors and the table of HTTP statuses."""

from __future__ import annotations

from http import HTTPStatus

_HEAD = "| code | HTTP status | meaning | exception |\n| --- | --- | --- | --- |\n"


def error_reference() -> str:
    """The error codes as a Markdown table."""
    from firstfix.errors import all_errors
    from firstfix_service.problems import STATUS

    rows = []
    for error in sorted(all_errors(), key=lambda error: (STATUS[error], error.code)):
        status = STATUS[error]
        title = HTTPStatus(status).phrase if status in {s.value for s in HTTPStatus} else "Checksum Mismatch"
        rows.append(f"| `{error.code}` | {status} {title} | {_meaning(error)} | `{error.__name__}` |")
    return _HEAD + "\n".join(rows) + "\n"


def _meaning(error: type[Exception]) -> str:
    """Returns the meaning of an error, from the tree in the module docstring."""
    import firstfix.errors

    for line in (firstfix.errors.__doc__ or "").splitlines():
        words = line.strip(" |`-").split(None, 1)
        if len(words) == 2 and words[0] == error.__name__:
            return words[1]
    return (error.__doc__ or "").strip().split("\n")[0]
