"""Writes what is told of the code elsewhere: the formats of scans, and the description of the HTTP API.

python scripts/generate.py
"""

from __future__ import annotations

import json
import re
from pathlib import Path

from firstfix.decode import SCAN_FORMATS, SUFFIXES
from firstfix.findings import scan_kinds
from firstfix.findings.registry import kinds_of
from firstfix_service.app import create_app
from firstfix_service.settings import Settings

REPO = Path(__file__).resolve().parents[1]
FINDINGS_PAGE = "docs/how-to/my-scan-is-not-localized.md"
WRONG_INPUTS_PAGE, WRONG_INPUTS_HEAD = "docs/reference/wrong-inputs.md", "| input | answer |\n|---|---|\n"
FINDINGS_HEAD = "| symptom | code | the answer says | what helps |\n|---|---|---|---|\n"


def generated() -> dict[Path, str]:
    """Returns the files and their texts as they should be."""
    formats = "".join(
        f"| {each.encoding} | {' or '.join(f'`{name}`' for name in each.media_types)} |\n"
        for each in SCAN_FORMATS
    )
    endings = "".join(f'  "{suffix}": "{name}",\n' for suffix, name in SUFFIXES.items())
    document = create_app(Settings(store="memory://")).openapi()
    return {
        REPO / "docs/openapi.json": json.dumps(document, indent=1, sort_keys=True) + "\n",
        **_between(FINDINGS_PAGE, FINDINGS_HEAD, _findings(), "\n"),
        **_between(WRONG_INPUTS_PAGE, WRONG_INPUTS_HEAD, _wrong_inputs(), "\n"),
        **_between("clients/PROTOCOL.md", "| scan encoding | media type |\n|---|---|\n", formats, "\n"),
        **_between("console/src/scan/media.ts", "const TYPES: Record<string, string> = {\n", endings, "};\n"),
    }


def _findings() -> str:
    """Rows of the findings of scans, from symptom to remedy."""
    return "".join(
        f"| {kind.symptom} | `{kind.code}` | {_in_words(kind.text)} | {_in_words(kind.remedy)} |\n"
        for kind in kinds_of(scan_kinds)
    )


def _wrong_inputs() -> str:
    """Rows of wrong inputs, and what they give over the command line and HTTP."""
    rows = []
    for row in json.loads((REPO / "tests/e2e/wrong_inputs.json").read_text()):
        told = {way: _told(row[way]) for way in ("command", "http") if way in row}
        if len({row[way]["text"] for way in told}) == 1:
            cell = told["command"]
        else:
            cell = f"*Command:* {told['command']}<br>*HTTP:* {told['http']}"
        rows.append(f"| {row['input']} | {cell} |\n")
    return "".join(rows)


def _told(answer: dict[str, str]) -> str:
    words = f"{answer['text']} {answer.get('remedy', '')}".strip().replace("|", "\\|")
    code = f", `{answer['code']}`" if "code" in answer else ""
    return f"{answer['answer']}{code}: {words}"


def _in_words(text: str) -> str:
    """A finding's text with the names of its numbers in place of them."""
    return re.sub(r"{(\w+)(:[^}]*)?}", lambda match: f"*{match[1]}*", text)


def _between(path: str, begin: str, text: str, end: str) -> dict[Path, str]:
    """Puts a text between two lines of a file."""
    before, found, rest = (REPO / path).read_text().partition(begin)
    assert found, f"{path} has no line {begin!r}"
    after = rest[rest.index("\n" + end) + 1 :]
    return {REPO / path: before + begin + text + after}


if __name__ == "__main__":
    for path, text in generated().items():
        path.write_text(text)
