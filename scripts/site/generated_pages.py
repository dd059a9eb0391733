"""Reference pages that only repeat the code: ``make docs`` makes them, and they are not kept.

Pages of the repository link to what such a page is made from. On the site the same links lead to the page.
"""

from __future__ import annotations

import json
from pathlib import Path

from cli_reference import cli_reference
from error_reference import error_reference
from http_reference import http_reference
from wrong_inputs_reference import wrong_inputs_reference

# Page of the site -> what it is made from, in the repository.
GENERATED = {
    "reference/http-endpoints.md": "docs/openapi.json",
    "reference/cli.md": "cli/firstfix_cli/commands",
    "reference/errors.md": "core/firstfix/errors.py",
    "reference/wrong-inputs.md": "tests/e2e/wrong_inputs.json",
    "reference/wrong-maps.md": "tests/e2e/wrong_maps.json",
}
_HTTP = """# HTTP endpoints

Every endpoint with its parameters, bodies and answers, and every schema. A running service gives the
document of which this page is made at `/openapi.json`. [The HTTP API](http-api.md) explains the calls with
examples.
"""
_CLI = """# Command line

Every command of `firstfix` with its options, from the commands' own help: `firstfix --help` shows the same.
[Scripts and exit codes](../how-to/command-line.md) explains how the commands find a service and what their
exit codes mean.
"""
_ERRORS = """# Errors

An error has the media type `application/problem+json`
([RFC 9457](https://www.rfc-editor.org/rfc/rfc9457)), over HTTP and over zenoh:

```json
{"type": "urn:firstfix:error:overloaded", "title": "Service Unavailable", "status": 503,
 "detail": "...", "code": "overloaded"}
```

Match on `code`. It never changes, while `detail` is for people. Where waiting helps, the HTTP header
`Retry-After` says for how many seconds. A scan that was not localized is an answer, not an error. The Python
client raises the exception that the last column names. [The protocol](../../clients/PROTOCOL.md#errors) has
the codes, too.
"""
_WRONG_INPUTS = """# Wrong inputs

What common mistakes give, over the command line and over HTTP. The inputs are made from a right scan of a
yard of 16 x 12 m by `tests/e2e/wrong_inputs.py`; `tests/e2e/test_wrong_inputs.py` runs them against a service
and compares. The numbers are those of that scan. An input that is `localized` all the same is at its right
place. [My scan is not localized](../how-to/my-scan-is-not-localized.md) has all findings.
"""
_WRONG_MAPS = """# Wrong maps

What common mistakes with maps give, by `firstfix check MAP`, or by the command that is named. The maps are
made of a right map of a yard of 16 x 12 m by `tests/e2e/wrong_maps.py`; `tests/e2e/test_wrong_maps.py` runs
them and compares. `firstfix build` and `POST /maps` refuse a map with an error in the same words. A map with
a warning is built all the same. [My map](../how-to/my-map.md#from-symptom-to-cause) has all findings.
"""


def generated_pages(repo: Path) -> dict[str, str]:
    """The pages by their places on the site."""
    document = json.loads((repo / "docs/openapi.json").read_text())
    tables = repo / "tests/e2e"
    parts = {
        "reference/http-endpoints.md": (_HTTP, http_reference(document)),
        "reference/cli.md": (_CLI, cli_reference()),
        "reference/errors.md": (_ERRORS, error_reference()),
        "reference/wrong-inputs.md": (_WRONG_INPUTS, wrong_inputs_reference(tables / "wrong_inputs.json")),
        "reference/wrong-maps.md": (_WRONG_MAPS, wrong_inputs_reference(tables / "wrong_maps.json")),
    }
    return {page: f"{head}\n{text}" for page, (head, text) in parts.items()}
