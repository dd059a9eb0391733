"""Answers to common mistakes, from the tables that the tests of wrong inputs compare."""

from __future__ import annotations

import json
from pathlib import Path

_HEAD = "| input | answer |\n|---|---|\n"


def wrong_inputs_reference(table: Path) -> str:
    """The wrong inputs of a table, and what they give over the command line and HTTP, as Markdown."""
    rows = []
    for row in json.loads(table.read_text()):
        told = {way: _told(row[way]) for way in ("command", "http") if way in row}
        if len({row[way]["text"] for way in told}) == 1:
            cell = told["command"]
        else:
            cell = f"*Command:* {told['command']}<br>*HTTP:* {told['http']}"
        rows.append(f"| {row['input']} | {cell} |\n")
    return _HEAD + "".join(rows)


def _told(answer: dict[str, str]) -> str:
    words = f"{answer['text']} {answer.get('remedy', '')}".strip().replace("|", "\\|")
    code = f", `{answer['code']}`" if "code" in answer else ""
    return f"{answer['answer']}{code}: {words}"
