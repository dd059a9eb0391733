from __future__ import annotations

import json
from datetime import datetime, timedelta, timezone
from pathlib import Path

import pytest

from firstfix.access.api_keys import ApiKeys, parse_token
from firstfix.access.permissions import Grant, Scope
from firstfix.store.store import Store
from firstfix_cli.main import run


def ended(*arguments: object) -> int:
    with pytest.raises(SystemExit) as caught:
        run([str(argument) for argument in arguments])
    return int(caught.value.code or 0)


@pytest.fixture
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Store:
    monkeypatch.setenv("FIRSTFIX_STORE", str(tmp_path / "store"))
    return Store.open(str(tmp_path / "store"))


def test_a_key_is_printed_once_and_alone(store: Store, capsys: pytest.CaptureFixture[str]):
    assert (
        ended(
            "keys", "create", "--scope", "localize", "--map", "hall-*", "--map", "yard", "--name", "robot-7"
        )
        == 0
    )
    out, err = capsys.readouterr()
    token = out.strip()
    parsed = parse_token(token)
    assert parsed is not None
    assert parsed[1] not in err
    ((key,), bad) = ApiKeys(store).all()
    assert (key.key_id, key.name, bad) == (parsed[0], "robot-7", [])
    assert key.grant == Grant(frozenset({Scope.LOCALIZE}), ("hall-*", "yard"))
    assert key.expires_time is None
    assert ended("keys", "ls") == 0
    out, _ = capsys.readouterr()
    assert parsed[0] in out
    assert "localize on hall-*,yard  never expires" in out
    assert parsed[1] not in out
    assert key.sha256 not in out


def test_the_store_may_be_given(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.delenv("FIRSTFIX_STORE", raising=False)
    where = tmp_path / "other"
    assert ended("keys", "create", "--store", where, "--scope", "admin", "--name", "x", "--json") == 0
    made = json.loads(capsys.readouterr().out)
    assert parse_token(made["key"])
    assert (made["scopes"], made["maps"]) == (["admin"], ["*"])
    assert ended("keys", "ls", "--store", where, "--json") == 0
    listed = json.loads(capsys.readouterr().out)
    assert [entry["key_id"] for entry in listed["keys"]] == [made["key_id"]]
    assert "key" not in listed["keys"][0]
    assert ended("keys", "ls") == 2, "no store"


@pytest.mark.parametrize(
    ("expires", "days"),
    [("90d", 90.0), ("12h", 0.5), ("2999-01-31", None), ("2999-01-31T12:00:00+02:00", None)],
)
def test_a_key_may_expire(store: Store, expires: str, days: float | None):
    assert ended("keys", "create", "--scope", "build", "--name", "x", "--expires", expires) == 0
    ((key,), _) = ApiKeys(store).all()
    assert key.expires_time is not None
    end = datetime.fromisoformat(key.expires_time)
    if days is None:
        wanted = datetime.fromisoformat(expires)
        assert end == (wanted if wanted.tzinfo else wanted.replace(tzinfo=timezone.utc))
    else:
        assert abs(end - datetime.now(timezone.utc) - timedelta(days=days)) < timedelta(minutes=5)


def test_a_key_is_revoked(store: Store, capsys: pytest.CaptureFixture[str]):
    key, _ = ApiKeys(store).create("x", Grant.parse(["admin"], ["*"]))
    assert ended("keys", "revoke", key.key_id) == 0
    assert ApiKeys(store).all()[0][0].revoked
    capsys.readouterr()
    assert ended("keys", "ls") == 0
    assert "revoked" in capsys.readouterr().out
    assert ended("keys", "revoke", "0" * 12) == 2
    assert ended("keys", "revoke", "../../maps") == 2


@pytest.mark.parametrize(
    "wrong",
    [
        ["--scope", "root"],
        ["--scope", "localize", "--map", "[a]"],
        ["--scope", "localize", "--expires", "soon"],
        ["--scope", "localize", "--expires", "2001-01-01"],
        ["--scope", "localize", "--name", ""],
        [],
    ],
)
def test_what_is_no_key_is_not_made(store: Store, wrong: list[str]):
    assert ended("keys", "create", "--name", "x", *wrong) == 2
    assert ApiKeys(store).all() == ([], [])


def test_an_error_line_hides_what_is_secret(capsys: pytest.CaptureFixture[str]):
    assert ended("maps", "ls", "--url", "http://robot:hunter2@127.0.0.1:9") == 1
    err = capsys.readouterr().err
    assert "127.0.0.1" in err
    assert "hunter2" not in err


def test_a_key_comes_from_the_environment_and_is_not_printed(
    store: Store, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    token = f"ffx_{'0f' * 6}_{'1e' * 32}"
    monkeypatch.setenv("ADMIN_KEY", token)
    create = ("keys", "create", "--scope", "admin", "--name", "admin", "--token-env", "ADMIN_KEY")
    assert (ended(*create), ended(*create)) == (0, 0)
    out, err = capsys.readouterr()
    assert "0f" * 6 in out
    assert "1e" * 32 not in out + err
    ((key,), _) = ApiKeys(store).all()
    assert key.matches("1e" * 32)
    monkeypatch.delenv("ADMIN_KEY")
    assert ended(*create) == 2
    assert "Traceback" not in capsys.readouterr().err
