"""Removal of type annotations from Python source. Every statement stays on its line."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

# Modules whose names only annotations use, in most modules.
_TYPING = ("__future__", "collections.abc", "numpy.typing", "types", "typing")


def strip_types(source: str, *, public: bool) -> str:
    """Returns the module without annotations of private functions and of local variables.

    Annotations of classes stay: dataclasses need them.

    Args:
        source: a module without comments.
        public: also removes annotations of public functions, and imports that only annotations used.
    """
    lines = [line.encode() for line in source.splitlines()]
    found = _annotations(ast.parse(source), public, in_function=False)
    for annotation, is_result in sorted(found, key=lambda one: _begin(one[0]), reverse=True):
        (first, begin), (last, end) = _begin(annotation), _end(annotation)
        mark = lines[first - 1].rfind(b" ->" if is_result else b":", 0, begin)
        if mark < 0:  # on the line before: the annotation stays
            continue
        kept = lines[last - 1][end:]
        lines[first - 1 : last] = [lines[first - 1][:mark] + kept, *[b""] * (last - first)]
    text = b"\n".join(lines).decode() + "\n"
    return _without_typing_imports(text) if public else text


def _annotations(node: ast.AST, public: bool, *, in_function: bool) -> Iterator[tuple[ast.expr, bool]]:
    """Yields annotations to remove, and whether each is that of a result."""
    for child in ast.iter_child_nodes(node):
        inner = public, in_function
        if isinstance(child, ast.ClassDef):
            inner = public or _is_private(child.name), False
        elif isinstance(child, (ast.FunctionDef, ast.AsyncFunctionDef)):
            inner = public or _is_private(child.name), True
            if inner[0]:
                yield from _of_signature(child)
        elif isinstance(child, ast.AnnAssign) and in_function and child.value is not None:
            yield child.annotation, False
        yield from _annotations(child, inner[0], in_function=inner[1])


def _of_signature(function: ast.FunctionDef | ast.AsyncFunctionDef) -> Iterator[tuple[ast.expr, bool]]:
    given = function.args
    for one in (*given.posonlyargs, *given.args, *given.kwonlyargs, given.vararg, given.kwarg):
        if one is not None and one.annotation is not None:
            yield one.annotation, False
    if function.returns is not None:
        yield function.returns, True


def _is_private(name: str) -> bool:
    return re.match(r"_[^_]", name) is not None


def _without_typing_imports(source: str) -> str:
    lines = source.splitlines()
    imports: list[ast.ImportFrom] = []
    blocks: list[ast.If] = []
    for node in ast.parse(source).body:
        if isinstance(node, ast.ImportFrom) and node.module in _TYPING:
            imports.append(node)
        elif isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            blocks.append(node)
    rest = list(lines)
    for node in (*imports, *blocks):
        _replace(rest, node, "")
    used = set(re.findall(r"\w+", "\n".join(rest)))
    if any(
        getattr(node, "annotation", None) or getattr(node, "returns", None)
        for node in ast.walk(ast.parse(source))
    ):
        used.add("annotations")  # of the future: they are not evaluated
    for block in blocks:
        names = {alias.asname or alias.name for one in block.body for alias in getattr(one, "names", ())}
        if names & used:
            used |= set(re.findall(r"\w+", ast.unparse(block)))
        else:
            _replace(lines, block, "")
    for node in imports:
        left = [ast.unparse(alias) for alias in node.names if (alias.asname or alias.name) in used]
        _replace(lines, node, f"from {node.module} import {', '.join(left)}" if left else "")
    return "\n".join(lines) + "\n"


def _replace(lines: list[str], node: ast.stmt, text: str) -> None:
    assert node.end_lineno is not None
    lines[node.lineno - 1 : node.end_lineno] = [text, *[""] * (node.end_lineno - node.lineno)]


def _begin(node: ast.expr) -> tuple[int, int]:
    return node.lineno, node.col_offset


def _end(node: ast.expr) -> tuple[int, int]:
    assert node.end_lineno is not None
    assert node.end_col_offset is not None
    return node.end_lineno, node.end_col_offset
