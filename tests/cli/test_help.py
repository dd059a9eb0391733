"""Help texts: complete, not cut off, and with examples that are valid commands."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from typing import Any

import pytest
import typer

from firstfix_cli.main import app

ROOT = typer.main.get_command(app)


def nodes(node: Any = ROOT, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yields every group and command with its path."""
    yield path, node
    for name, child in getattr(node, "commands", {}).items():
        if child.hidden:
            continue
        yield from nodes(child, (*path, name))


def parsed(command: str) -> None:
    """Parses a command line without running it."""
    node, words = ROOT, shlex.split(command)[1:]
    while hasattr(node, "commands"):
        node = node.commands[words.pop(0)]
    node.make_context(command, words)


def examples() -> list[str]:
    lines = [line.strip() for _, node in nodes() for line in (node.epilog or "").splitlines()]
    return [line for line in lines if line.startswith("firstfix ")]


GROUPS = [path for path, node in nodes() if hasattr(node, "commands")]


@pytest.mark.parametrize("path", GROUPS, ids=" ".join)
def test_the_list_of_commands_cuts_no_summary(path, capsys):
    with pytest.raises(SystemExit):
        app([*path, "--help"])
    listed = capsys.readouterr().out.partition("Commands:")[2].partition("Examples:")[0].strip().splitlines()
    node = dict(nodes())[path]
    shown = [command for command in node.commands.values() if not command.hidden]
    assert len(listed) == len(shown), "one line for each command"
    assert not [line for line in listed if not line.endswith(".") or line.endswith("...")]


def test_every_parameter_has_a_help_text():
    bare = [
        (*path, parameter.name)
        for path, node in nodes()
        for parameter in node.params
        if not (parameter.help or "").rstrip().endswith((".", "].", "..."))
    ]
    assert not bare


def test_every_top_command_has_examples():
    for path, node in nodes():
        if len(path) == 1:
            assert f"firstfix {path[0]}" in (node.epilog or ""), path


@pytest.mark.parametrize("command", examples())
def test_an_example_is_a_valid_command(command):
    parsed(command)


@pytest.mark.parametrize("command", ["firstfix maps show", "firstfix serve --shop x"])
def test_an_invalid_command_is_noticed(command):
    with pytest.raises(Exception, match=r"(?i)missing|no such option"):
        parsed(command)
