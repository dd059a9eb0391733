"""API keys, and what they permit."""

from __future__ import annotations

import json
from datetime import datetime, timedelta, timezone
from pathlib import Path

import pytest

from firstfix.access.api_keys import ApiKeys, parse_token
from firstfix.access.permissions import Grant, Scope
from firstfix.errors import Conflict, InvalidOption, NotFound
from firstfix.store.store import Store

GRANT = Grant.parse(["localize"], ["hall-*"])


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store.open(str(tmp_path / "store"))


def test_a_key_is_read_back_by_another_process(any_store: Store):
    store = any_store
    key, token = ApiKeys(store).create("robot-7", GRANT)
    found, bad = ApiKeys(store).all()
    assert (found, bad) == ([key], [])
    key_id, secret = parse_token(token)
    assert key_id == key.key_id
    assert found[0].matches(secret)
    assert not found[0].matches(secret[:-1] + ("0" if secret[-1] != "0" else "1"))
    assert found[0].grant.scopes == {Scope.LOCALIZE}


def test_the_secret_is_nowhere_in_the_store(store: Store, tmp_path: Path):
    key, token = ApiKeys(store).create("robot-7", GRANT)
    secret = token.rpartition("_")[2]
    files = [path for path in (tmp_path / "store").rglob("*") if path.is_file()]
    assert [path.name for path in files] == [f"{key.key_id}.json"]
    assert secret not in files[0].read_text()
    assert "sha256" in json.loads(files[0].read_text())
    assert "sha256" not in key.to_mapping()


def test_secrets_differ_and_have_256_bits(store: Store):
    tokens = [ApiKeys(store).create("r", GRANT)[1] for _ in range(5)]
    secrets = {token.split("_")[2] for token in tokens}
    assert len(secrets) == 5
    assert {len(secret) for secret in secrets} == {64}


def test_a_revoked_key_stays_on_record(store: Store):
    keys = ApiKeys(store)
    key, _ = keys.create("robot-7", GRANT)
    other, _ = keys.create("robot-8", GRANT)
    keys.revoke(key.key_id)
    keys.revoke(key.key_id)
    for reader in (keys, ApiKeys(store)):
        found = {entry.key_id: entry.revoked for entry in reader.all()[0]}
        assert found == {key.key_id: True, other.key_id: False}
    with pytest.raises(NotFound):
        keys.revoke("0" * 12)
    with pytest.raises(InvalidOption):
        keys.revoke("../../maps")


def test_a_key_expires(store: Store):
    now = datetime.now(timezone.utc)
    key, _ = ApiKeys(store).create("r", GRANT, now + timedelta(hours=1))
    assert not key.is_expired(now)
    assert key.is_expired(now + timedelta(hours=1, seconds=1))
    with pytest.raises(InvalidOption, match="expired"):
        ApiKeys(store).create("r", GRANT, now - timedelta(seconds=1))


@pytest.mark.parametrize("name", ["", "x" * 101, "a\nb", "a\x00b"])
def test_an_invalid_name_is_refused(store: Store, name: str):
    with pytest.raises(InvalidOption, match="name"):
        ApiKeys(store).create(name, GRANT)


RECORD = {"name": "x", "scopes": ["admin"], "maps": ["*"], "sha256": "0" * 64, "expires_time": None}


@pytest.mark.parametrize(
    "record",
    [
        *(b"", b"[]", b"{}", b'{"scopes": ["root"]}'),
        json.dumps({**RECORD, "sha256": None, "created_time": "2030-01-01T00:00:00+00:00"}).encode(),
        json.dumps({**RECORD, "created_time": "2030-01-01T00:00:00"}).encode(),
        pytest.param(b"[" * 50_000, id="deep"),
        pytest.param(b" " * 100_000, id="long"),
    ],
)
def test_an_unreadable_record_is_named_and_lets_nobody_in(store: Store, record: bytes):
    keys = ApiKeys(store)
    good, _ = keys.create("robot-7", GRANT)
    store.put("keys/0123456789ab.json", record)
    store.put("keys/notes.txt", b"something else")
    assert keys.all() == ([good], ["0123456789ab"])


@pytest.mark.parametrize(
    "token",
    ["", "ffx_", "ffx_0123456789ab_", f"ffx_0123456789ab_{'g' * 64}", f"ffx_0123456789ab_{'a' * 65}"]
    + [f" ffx_0123456789ab_{'a' * 64}", f"ffx_0123456789ab_{'a' * 64}\n", f"ffx_0123456789AB_{'a' * 64}"],
)
def test_an_invalid_token_is_not_parsed(token: str):
    assert parse_token(token) is None


GIVEN = f"ffx_{'0f' * 6}_{'1e' * 32}"


def test_a_key_made_elsewhere_is_entered_once(store: Store):
    first, token = ApiKeys(store).create("admin", GRANT, token=GIVEN)
    again, _ = ApiKeys(store).create("admin", GRANT, token=GIVEN)
    assert (token, again) == (GIVEN, first)
    assert first.key_id == "0f" * 6
    assert ApiKeys(store).all() == ([first], [])
    assert first.matches("1e" * 32)


@pytest.mark.parametrize(
    ("name", "grant", "token"),
    [
        ("other", GRANT, GIVEN),
        ("admin", Grant.parse(["admin"], ["*"]), GIVEN),
        ("admin", GRANT, GIVEN[:-1] + "f"),
    ],
)
def test_another_key_of_the_same_id_is_refused(store: Store, name: str, grant: Grant, token: str):
    first, _ = ApiKeys(store).create("admin", GRANT, token=GIVEN)
    with pytest.raises(Conflict):
        ApiKeys(store).create(name, grant, token=token)
    assert ApiKeys(store).all() == ([first], [])


@pytest.mark.parametrize("token", ["", "secret", GIVEN[:-1], GIVEN.upper(), GIVEN + "0"])
def test_a_weak_token_is_refused(store: Store, token: str):
    with pytest.raises(InvalidOption):
        ApiKeys(store).create("admin", GRANT, token=token)


def test_a_revoked_key_is_not_revived_by_its_token(store: Store):
    keys = ApiKeys(store)
    key, _ = keys.create("admin", GRANT, token=GIVEN)
    keys.revoke(key.key_id)
    keys.create("admin", GRANT, token=GIVEN)
    assert [found.revoked for found in ApiKeys(store).all()[0]] == [True]


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
def test_a_scope_includes_lower_ones(given: list[str], allowed: set[Scope]):
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
def test_patterns_cover_map_ids(pattern: str, covered: list[str], not_covered: list[str]):
    grant = Grant.parse(["localize"], [pattern, "other"])
    assert all(grant.covers(map_id) for map_id in [*covered, "other"])
    assert not any(grant.covers(map_id) for map_id in not_covered)


@pytest.mark.parametrize(
    ("scopes", "maps"),
    [
        *(([], ["*"]), (["root"], ["*"]), (["localize"], [])),
        *((["localize"], [pattern]) for pattern in ("[a-z]*", "Hall", "a/b", "", "x" * 64)),
        (["localize"], [f"m{n}" for n in range(101)]),
    ],
)
def test_an_invalid_grant_is_refused(scopes: list[str], maps: list[str]):
    with pytest.raises(InvalidOption):
        Grant.parse(scopes, maps)


def test_no_scope_and_no_map_allow_nothing():
    nothing = Grant(frozenset(), ())
    assert not any(nothing.allows(scope) for scope in Scope)
    assert not nothing.covers("hall")
