"""Every command in the documents exists: commands of firstfix with their options, and Python modules."""

import re
import shlex
from importlib.util import find_spec
from pathlib import Path

import pytest
import typer

from firstfix.doors import absent
from firstfix_cli.main import app

pytestmark = pytest.mark.skipif(bool(absent()), reason="pages tell of packages that are left out here")
REPO = Path(__file__).resolve().parents[2]
PAGES = sorted(
    [
        *(REPO / name for name in ("README.md", "CONTRIBUTING.md", "examples/README.md")),
        *(page for folder in ("docs", "clients", "lab") for page in (REPO / folder).rglob("*.md")),
    ]
)
# Shell commands are indented or fenced. Variables, a container or a virtual environment may come first.
LINE = re.compile(
    r"^(?: {4})*(?:[A-Z_]+=\S+ +|.* -- |docker compose exec \w+ |\.venv/bin/)*(firstfix [^#\n]*)", re.M
)
INLINE = re.compile(r"`(firstfix [a-z][^`]*)`")
MODULE = re.compile(r"python3? -m ([\w.]+)")


def documented(page: Path) -> list[str]:
    text = page.read_text().replace("\\\n", " ")
    shell = [
        text for text in re.findall(r"^```(\w*)\n(.*?)^```", text, re.M | re.S) if text[0] in ("sh", "bash")
    ]
    prose = re.sub(r"^```.*?^```", "", text, flags=re.M | re.S)
    indented = "\n".join(re.findall(r"^ {4}.*$", prose, re.M))
    lines = [line for part in (indented, *(block for _, block in shell)) for line in LINE.findall(part)]
    lines += [" ".join(line.split()) for line in INLINE.findall(prose)]
    return [
        part.strip(" &") for line in lines for part in line.split("&&") if part.strip().startswith("firstfix")
    ]


def wrong_with(command: str) -> str | None:
    words = shlex.split(command)[1:]
    node = typer.main.get_command(app)
    while hasattr(node, "commands"):
        if not words:
            return None  # a group alone prints its help
        word = words.pop(0)
        if word.startswith("-"):
            return None  # firstfix --help
        if word not in node.commands:
            return f"no command {word!r}"
        node = node.commands[word]
    known = {"--help", *(name for option in node.params for name in (*option.opts, *option.secondary_opts))}
    strange = [word for word in words if re.match(r"--?[a-zA-Z]", word) and word.split("=")[0] not in known]
    return f"no options {strange}" if strange else None


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(REPO).as_posix())
def test_documented_commands_are_there(page: Path):
    wrong = {command: wrong_with(command) for command in documented(page)}
    assert not {command: reason for command, reason in wrong.items() if reason}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(REPO).as_posix())
def test_documented_modules_are_there(page: Path):
    named = {name.rstrip(".") for name in MODULE.findall(page.read_text())}
    assert not {name for name in named if not is_module(name)}


def is_module(name: str) -> bool:
    try:
        return find_spec(name) is not None
    except ModuleNotFoundError:
        return False


def test_there_are_some_to_look_at():
    assert len(documented(REPO / "docs/how-to/my-map.md")) > 20
    assert sum(len(documented(page)) for page in PAGES) > 80
    assert wrong_with("firstfix maps roll-back hall") == "no command 'roll-back'"
    assert wrong_with("firstfix serve --shop x") == "no options ['--shop']"
    assert is_module("firstfix_lab.demo")
    assert not is_module("benchmarks.nothing")
    assert not is_module("nothing.at_all")
