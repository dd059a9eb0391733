"""The commands of ``firstfix``, from their own help."""

from __future__ import annotations

from typing import Any

import typer


def cli_reference() -> str:
    """The commands as Markdown."""
    from firstfix_cli.main import app

    parts: list[str] = []
    _add(parts, typer.main.get_command(app), "firstfix", 1)
    return "\n\n".join(parts) + "\n"


def _add(parts: list[str], command: Any, path: str, depth: int) -> None:
    if depth > 1:
        parts += [f"{'#' * depth} `{path}`", _text(command.help)]
    if hasattr(command, "commands"):
        _add_examples(parts, command)
        for name, child in command.commands.items():
            _add(parts, child, f"{path} {name}", depth + 1)
        return
    arguments = [parameter for parameter in command.params if parameter.param_type_name == "argument"]
    options = [
        parameter
        for parameter in command.params
        if parameter.param_type_name == "option" and not parameter.hidden
    ]
    usage = " ".join([path, *(_metavar(argument) for argument in arguments), "[OPTIONS]" if options else ""])
    parts.append(f"    {usage.strip()}")
    rows = [f"| `{_metavar(argument)}` | {_help(argument)} |" for argument in arguments]
    rows += [f"| {_names(option)} | {_help(option)} |" for option in options]
    if rows:
        parts.append("\n".join(["| argument or option | meaning |", "| --- | --- |", *rows]))
    _add_examples(parts, command)


def _add_examples(parts: list[str], command: Any) -> None:
    if command.epilog:
        parts.append(f"```text\n{_text(command.epilog)}\n```")


def _metavar(parameter: Any) -> str:
    name = parameter.metavar or parameter.name.upper()
    return name if parameter.required else f"[{name}]"


def _names(option: Any) -> str:
    names = ", ".join(f"`{name}`" for name in [*option.opts, *option.secondary_opts])
    return names if option.is_flag else f"{names} *{_kind(option)}*"


def _kind(option: Any) -> str:
    kind = getattr(option, "type", None)  # typer before 0.29
    name = kind.name if kind else option.type_descriptor.annotation.__name__
    return {"str": "text", "int": "integer"}.get(name, name).lower()


def _help(parameter: Any) -> str:
    text = _text(getattr(parameter, "help", None)).replace("|", "\\|").replace("\n", " ")
    default = parameter.default
    if parameter.required:
        return f"{text} Required.".strip()
    if default in (None, False, ()) or callable(default):
        return text
    return f"{text} Default: `{default}`."


def _text(help_text: str | None) -> str:
    return (help_text or "").replace("\b\n", "").strip()
