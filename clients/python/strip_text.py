"""Removal of docstrings and comments from Python source. Every statement stays on its line."""

from __future__ import annotations

import ast
import io
import tokenize


def strip_text(source: str) -> str:
    """Returns the module without docstrings and comments. Line numbers stay, for tracebacks."""
    lines = source.splitlines()
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
            continue
        if ast.get_docstring(node, clean=False) is not None:
            is_needed = len(node.body) == 1 and not isinstance(node, ast.Module)  # a body needs a statement
            _blank(lines, node.body[0], "..." if is_needed else "")
    for token in tokenize.generate_tokens(io.StringIO("\n".join(lines)).readline):
        if token.type == tokenize.COMMENT:
            row, column = token.start
            lines[row - 1] = lines[row - 1][:column].rstrip()
    return "\n".join(lines) + "\n"


def _blank(lines: list[str], docstring: ast.stmt, instead: str) -> None:
    assert docstring.end_lineno is not None
    lines[docstring.lineno - 1] = f"{lines[docstring.lineno - 1][: docstring.col_offset]}{instead}".rstrip()
    for row in range(docstring.lineno, docstring.end_lineno):
        lines[row] = ""
