"""Docstrings begin with a plain summary: a noun phrase or an imperative, no riddle, no section heading."""

from __future__ import annotations

import ast
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

REPO = Path(__file__).resolve().parents[2]
OPENING = re.compile(
    r"(What|Whatever|That|Those|Where|Which|Who|Whoever|Whose|Whom|How|Why|When|Whether|As|Of|But|And|To|It|They"
    r"|None|Nobody|Nothing|Somebody|Something)\b"
)
HEADING = re.compile(r"(Attributes|Args|Returns|Raises|Yields):")


def docstrings(path: Path) -> Iterator[tuple[int, str]]:
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
            text = ast.get_docstring(node)
            if text:
                yield getattr(node, "lineno", 1), text


def is_riddle(text: str) -> bool:
    return bool(HEADING.match(text) or OPENING.match(text))


def python_files() -> list[str]:
    listed = subprocess.run(["git", "ls-files", "*.py"], cwd=REPO, capture_output=True, text=True, check=True)
    return listed.stdout.split()


def test_docstrings_begin_with_a_plain_summary():
    riddles = [
        f"{name}:{line}: {text.splitlines()[0]}"
        for name in python_files()
        for line, text in docstrings(REPO / name)
        if is_riddle(text)
    ]
    assert not riddles, "\n" + "\n".join(riddles)


@pytest.mark.parametrize(
    "text",
    ["What is known of a map.", "Where a scan may have been taken.", "Attributes:\n    a: b", "Of a robot."],
)
def test_a_riddle_is_recognised(text: str):
    assert is_riddle(text)


@pytest.mark.parametrize(
    "text", ["Returns whether it is.", "Whole numbers.", "Pose of a robot.", "Raises a flag."]
)
def test_plain_summaries_pass(text: str):
    assert not is_riddle(text)
