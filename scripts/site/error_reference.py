"""The page of error codes, from the tree of errors and the table of HTTP statuses."""

from __future__ import annotations

from http import HTTPStatus

_HEAD = """# Errors

An error has the media type `application/problem+json` ([RFC 9457](https://www.rfc-editor.org/rfc/rfc9457)), over
HTTP and over zenoh:

```json
{"type": "urn:firstfix:error:overloaded", "title": "Service Unavailable", "status": 503,
 "detail": "...", "code": "overloaded"}
```

Match on `code`. It never changes, while `detail` is for people. Where waiting helps, the HTTP header `Retry-After`
says how many seconds. A scan that was not localized is an answer, not an error.

This page is generated from the code. The Python client raises the exception that the last column names.

| code | HTTP status | meaning | exception |
| --- | --- | --- | --- |
"""


def error_page() -> str:
    """The page as Markdown."""
    from firstfix.errors import all_errors
    from firstfix_service.problems import STATUS

    rows = []
    for error in sorted(all_errors(), key=lambda error: (STATUS[error], error.code)):
        status = STATUS[error]
        title = HTTPStatus(status).phrase if status in {s.value for s in HTTPStatus} else "Checksum Mismatch"
        rows.append(f"| `{error.code}` | {status} {title} | {_meaning(error)} | `{error.__name__}` |")
    return _HEAD + "\n".join(rows) + "\n"


def _meaning(error: type[Exception]) -> str:
    """What the module's tree of errors says of a class."""
    import firstfix.errors

    for line in (firstfix.errors.__doc__ or "").splitlines():
        words = line.strip(" |`-").split(None, 1)
        if len(words) == 2 and words[0] == error.__name__:
            return words[1]
    return (error.__doc__ or "").strip().split("\n")[0]
