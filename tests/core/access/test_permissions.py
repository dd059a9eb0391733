from __future__ import annotations

import pytest

from firstfix.access.permissions import Grant, Scope
from firstfix.errors import InvalidOption


@pytest.mark.parametrize(
    ("given", "allowed"),
    [
        (["localize"], {Scope.LOCALIZE}),
        (["build"], {Scope.LOCALIZE, Scope.BUILD}),
        (["metrics"], {Scope.METRICS}),
        (["localize", "metrics"], {Scope.LOCALIZE, Scope.METRICS}),
        (["admin"], set(Scope)),
    ],
)
def test_what_a_scope_includes(given: list[str], allowed: set[Scope]):
    grant = Grant.parse(given, ["*"])
    assert {scope for scope in Scope if grant.allows(scope)} == allowed


@pytest.mark.parametrize(
    ("pattern", "covered", "not_covered"),
    [
        ("*", ["hall", "a-1_b"], []),
        ("hall", ["hall"], ["hall-1", "hal", "xhall"]),
        ("hall-*", ["hall-", "hall-7", "hall-7-b"], ["hall", "shall-7"]),
        ("hall-?", ["hall-7"], ["hall-", "hall-77"]),
        ("*-lab-*", ["a-lab-b"], ["lab"]),
    ],
)
def test_patterns(pattern: str, covered: list[str], not_covered: list[str]):
    grant = Grant.parse(["localize"], [pattern, "other"])
    assert all(grant.covers(map_id) for map_id in [*covered, "other"])
    assert not any(grant.covers(map_id) for map_id in not_covered)


@pytest.mark.parametrize(
    ("scopes", "maps"),
    [
        ([], ["*"]),
        (["root"], ["*"]),
        (["localize"], []),
        (["localize"], ["[a-z]*"]),
        (["localize"], ["Hall"]),
        (["localize"], ["a/b"]),
        (["localize"], [""]),
        (["localize"], ["x" * 64]),
        (["localize"], [f"m{n}" for n in range(101)]),
    ],
)
def test_what_is_no_grant(scopes: list[str], maps: list[str]):
    with pytest.raises(InvalidOption):
        Grant.parse(scopes, maps)


def test_no_scope_and_no_map_allow_nothing():
    nothing = Grant(frozenset(), ())
    assert not any(nothing.allows(scope) for scope in Scope)
    assert not nothing.covers("hall")
