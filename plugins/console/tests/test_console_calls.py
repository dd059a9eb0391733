"""The console has one way to call the service: the functions of plugins/console/page/src/api."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

SOURCES = Path(__file__).resolve().parents[1] / "page" / "src"
CLIENT = SOURCES / "api" / "client.ts"
BY_ITSELF = re.compile(r"(?<![\w.])fetch\(|\bXMLHttpRequest\b|\bnew EventSource\b|\bsendBeacon\b")
TYPED_CLIENT = re.compile(r"import \{[^}]*\bapi\b[^}]*\} from \"[./]*(?:api/)?client\"")


def of(pattern: re.Pattern[str]) -> set[str]:
    """Sources that have it, by their paths below plugins/console/page/src."""
    return {
        path.relative_to(SOURCES).as_posix()
        for path in SOURCES.rglob("*.ts*")
        if not path.name.endswith(".d.ts") and pattern.search(path.read_text())
    }


@pytest.mark.parametrize(
    "text",
    ["await fetch(address)", "new XMLHttpRequest()", "new EventSource(path)", "navigator.sendBeacon(path)"],
)
def test_a_call_of_ones_own_is_seen(text):
    assert BY_ITSELF.search(text)
    assert not BY_ITSELF.search("// read over fetch: cache.fetch(1)")


def test_one_file_sends_requests():
    assert of(BY_ITSELF) == {CLIENT.relative_to(SOURCES).as_posix()}


def test_views_call_functions_with_types():
    callers = of(TYPED_CLIENT)
    assert callers
    assert {path.split("/")[0] for path in callers} == {"api"}
