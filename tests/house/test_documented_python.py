"""The Python examples in the documents parse, import existing names, and call the client correctly."""

import ast
import inspect
import re
from importlib import import_module
from pathlib import Path

import pytest

from firstfix_client import Client, ScanSequence

REPO = Path(__file__).resolve().parents[2]
PAGES = sorted(
    [REPO / "README.md", REPO / "examples" / "README.md"]
    + [page for folder in ("docs", "clients") for page in (REPO / folder).rglob("*.md")]
)
OWNERS = {"client": Client, "ScanSequence": ScanSequence}


def examples(page: Path) -> list[ast.Module]:
    return [ast.parse(text) for text in re.findall(r"^```python\n(.*?)^```", page.read_text(), re.M | re.S)]


def wrong_in(example: ast.Module) -> list[str]:
    wrong = []
    for node in ast.walk(example):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("firstfix"):
            module = import_module(node.module or "")
            wrong += [f"no {item.name}" for item in node.names if not hasattr(module, item.name)]
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            owner = OWNERS.get(node.func.value.id) if isinstance(node.func.value, ast.Name) else None
            if owner is not None:
                wrong += wrong_with(owner, node)
    return wrong


def wrong_with(owner: type, call: ast.Call) -> list[str]:
    assert isinstance(call.func, ast.Attribute)
    method = getattr(owner, call.func.attr, None)
    if method is None:
        return [f"no method {call.func.attr}"]
    known = inspect.signature(method).parameters
    return [f"{call.func.attr}: no {word.arg}" for word in call.keywords if word.arg not in known]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(REPO).as_posix())
def test_documented_python_uses_what_there_is(page: Path):
    assert [mistake for example in examples(page) for mistake in wrong_in(example)] == []


def test_mistakes_are_seen():
    assert sum(len(examples(page)) for page in PAGES) >= 6
    assert wrong_in(ast.parse("from firstfix_client import Nobody")) == ["no Nobody"]
    assert wrong_in(ast.parse("client.localize(scan, map_idd='x')")) == ["localize: no map_idd"]
    assert wrong_in(ast.parse("client.locate(scan)")) == ["no method locate"]
