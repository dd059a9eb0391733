"""Every command of firstfix in the documents is one that there is, with options that it has."""

import re
import shlex
from pathlib import Path

import pytest
import typer

from firstfix_cli.main import app

REPO = Path(__file__).resolve().parents[2]
PAGES = sorted([REPO / "README.md", *(REPO / "docs").rglob("*.md")])
LINE = re.compile(r"^    (?:[A-Z_]+=\S+ |.* -- )*(firstfix [^#\n]*)", re.M)


def documented(page: Path) -> list[str]:
    lines = LINE.findall(page.read_text().replace("\\\n", " "))
    return [
        part.strip() for line in lines for part in line.split("&&") if part.strip().startswith("firstfix")
    ]


def wrong_with(command: str) -> str | None:
    words = shlex.split(command)[1:]
    node = typer.main.get_command(app)
    while hasattr(node, "commands"):
        word = words.pop(0) if words else ""
        if word.startswith("-"):
            return None  # firstfix --help
        if word not in node.commands:
            return f"no command {word!r}"
        node = node.commands[word]
    known = {"--help", *(name for option in node.params for name in (*option.opts, *option.secondary_opts))}
    strange = [word for word in words if re.match(r"--?[a-zA-Z]", word) and word.split("=")[0] not in known]
    return f"no options {strange}" if strange else None


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_documented_commands_are_there(page: Path):
    wrong = {command: wrong_with(command) for command in documented(page)}
    assert not {command: reason for command, reason in wrong.items() if reason}


def test_there_are_some_to_look_at():
    assert sum(len(documented(page)) for page in PAGES) > 30
    assert wrong_with("firstfix maps roll-back hall") == "no command 'roll-back'"
    assert wrong_with("firstfix serve --shop x") == "no options ['--shop']"
