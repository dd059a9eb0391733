"""Help texts in words: ``--store TEXT`` and ``MAP``, where the library writes ``<str>`` and ``{MAP}``."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

import typer

_TYPE = re.compile(r"<(?:list\[)?([^<>\]]+)\]?>")
_WORDS = {
    "str": "TEXT",
    "int": "NUMBER",
    "float": "NUMBER",
    "int range": "NUMBER",
    "float range": "NUMBER",
    "path": "PATH",
    "Path": "PATH",
    "file": "PATH",
    "directory": "PATH",
}


class Commands(typer.core.TyperGroup):
    """Commands whose parameters are shown in words, those of groups within too."""

    def __init__(self, **values: Any) -> None:
        super().__init__(**values)
        _in_words([self])


def _in_words(commands: Iterable[Any]) -> None:
    for command in commands:
        for parameter in command.params:
            (_name_argument if parameter.param_type_name == "argument" else _name_option)(parameter)
        _in_words(getattr(command, "commands", {}).values())


def _name_argument(parameter: Any) -> None:
    word = (parameter.metavar or parameter.name.upper()).strip("[].")
    many = "..." if parameter.nargs != 1 else ""
    usage = f"{word}{many}" if parameter.required else f"[{word}{many}]"
    record = parameter.get_help_record
    parameter.get_usage_pieces = lambda ctx: [usage]

    def get_help_record(ctx: Any) -> tuple[str, str] | None:
        told = record(ctx)
        return None if told is None else (word, told[1])

    parameter.get_help_record = get_help_record


def _name_option(parameter: Any) -> None:
    record = parameter.get_help_record

    def get_help_record(ctx: Any) -> tuple[str, str] | None:
        told = record(ctx)
        return (
            None if told is None else (_TYPE.sub(lambda kind: _WORDS.get(kind[1], kind[1]), told[0]), told[1])
        )

    parameter.get_help_record = get_help_record
