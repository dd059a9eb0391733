"""JSON Web Tokens: their permissions, attempts to forge them, and the keys of a real issuer on loopback."""

from __future__ import annotations

import asyncio
import base64
import hashlib
import hmac
import json
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jwt
import pytest
from cryptography.hazmat.primitives import serialization

from firstfix.access.permissions import Scope
from firstfix.errors import FirstfixError, InvalidOption, Overloaded, Unauthorized
from firstfix_service.auth import jwks as jwks_module
from firstfix_service.auth import token_verifier
from firstfix_service.auth.jwks import Jwks
from firstfix_service.auth.principal import Principal
from firstfix_service.auth.token_verifier import TokenVerifier
from tests.service.access_world import Clock
from tests.service.service_world import publish, running_service
from tests.service.token_world import (
    ALL_KEYS,
    AUDIENCE,
    ISSUER,
    KEYS,
    OTHER,
    SHORT,
    Issuer,
    claims,
    key_set,
    public_jwk,
    settings,
    signed,
)
from tests.waiting import wait_until, wait_until_async


@pytest.fixture
def key_file(tmp_path: Path) -> Path:
    path = tmp_path / "jwks.json"
    path.write_text(json.dumps(ALL_KEYS))
    return path


def caller_of(key_file: Path, token: str, **changes: Any) -> Principal:
    return asyncio.run(TokenVerifier(settings(key_file, **changes)).principal(token))


@pytest.mark.parametrize("algorithm", KEYS)
def test_a_token_of_the_issuer_is_accepted(key_file: Path, algorithm: str):
    caller = caller_of(key_file, signed(algorithm))
    assert caller.name == "jwt:robot-7"
    assert caller.grant.scopes == {Scope.LOCALIZE}
    assert caller.sees("any")


REFUSED: dict[str, Callable[[], str]] = {
    "expired": lambda: signed(exp=time.time() - 60),
    "not yet": lambda: signed(nbf=time.time() + 60),
    "from the future": lambda: signed(iat=time.time() + 60),
    "another issuer": lambda: signed(iss="https://evil.example.org/"),
    "another audience": lambda: signed(aud="billing"),
    "no expiry": lambda: signed(exp=None),
    "no issuer": lambda: signed(iss=None),
    "no audience": lambda: signed(aud=None),
    "no subject": lambda: signed(sub=None),
    "another key": lambda: signed(key=OTHER),
    "unknown key id": lambda: signed(kid="nobody"),
    "key of another kind": lambda: signed("RS256", kid="es256"),
    "algorithm not allowed": lambda: jwt.encode(claims(), KEYS["RS256"], "PS256", headers={"kid": "rs256"}),
    "RS512 with a key of RS256": lambda: jwt.encode(
        claims(), KEYS["RS256"], "RS512", headers={"kid": "rs256"}
    ),
    "cut off": lambda: signed()[:-10],
    "signature of nothing": lambda: signed().rpartition(".")[0] + ".",
    "no token": lambda: "eyJhbGciOiJub25lIn0",
    "too long": lambda: signed(padding="x" * 9000),
    "not text": lambda: "\udcff.\udcff.\udcff",
}


@pytest.mark.parametrize("case", REFUSED)
def test_invalid_tokens_are_refused(key_file: Path, case: str):
    with pytest.raises(Unauthorized):
        caller_of(key_file, REFUSED[case]())


def encoded(part: Any) -> str:
    data = part if isinstance(part, bytes) else json.dumps(part).encode()
    return base64.urlsafe_b64encode(data).rstrip(b"=").decode()


@pytest.mark.parametrize("name", ["none", "None", "NONE", "", None, 0, ["ES256"]])
def test_an_unsigned_token_is_refused(key_file: Path, name: Any):
    head = encoded({"alg": name, "kid": "es256", "typ": "JWT"})
    for signature in ("", encoded(b"x")):
        with pytest.raises(Unauthorized):
            caller_of(key_file, f"{head}.{encoded(claims())}.{signature}")


@pytest.mark.parametrize("kind", ["RS256", "ES256"])
def test_a_token_signed_with_the_public_key_is_refused(key_file: Path, kind: str):
    """A known attack: HMAC with the bytes of the public key."""
    public = KEYS[kind].public_key()
    for encoding in (serialization.Encoding.PEM, serialization.Encoding.DER):
        secret = public.public_bytes(encoding, serialization.PublicFormat.SubjectPublicKeyInfo)
        body = f"{encoded({'alg': 'HS256', 'kid': kind.lower(), 'typ': 'JWT'})}.{encoded(claims())}"
        mac = hmac.new(secret, body.encode(), hashlib.sha256).digest()
        with pytest.raises(Unauthorized):
            caller_of(key_file, f"{body}.{encoded(mac)}")


def test_keys_within_the_token_are_ignored(key_file: Path):
    headers = {"kid": "mine", "jwk": public_jwk(OTHER, "ES256", "mine"), "jku": "http://127.0.0.1:1/keys"}
    with pytest.raises(Unauthorized):
        caller_of(key_file, jwt.encode(claims(), OTHER, "ES256", headers=headers))


@pytest.mark.parametrize("part", [0, 1])
def test_deep_json_in_a_token_is_refused(key_file: Path, part: int):
    parts = [encoded({"alg": "ES256", "kid": "es256"}), encoded(claims()), encoded(b"x")]
    parts[part] = encoded(b"[" * 3000)
    with pytest.raises(Unauthorized):
        caller_of(key_file, ".".join(parts))


@pytest.mark.filterwarnings("ignore:The RSA key is 1024 bits")
def test_a_short_rsa_key_is_refused(tmp_path: Path):
    path = tmp_path / "jwks.json"
    path.write_text(json.dumps(key_set(short=(SHORT, "RS256"))))
    with pytest.raises(Unauthorized):
        caller_of(path, signed("RS256", key=SHORT, kid="short"))


@pytest.mark.parametrize("change", [{"use": "enc"}, {"alg": "ES384"}, {"crv": "P-384"}, {"kty": "RSA"}])
def test_a_key_for_another_use_is_refused(tmp_path: Path, change: dict[str, str]):
    path = tmp_path / "jwks.json"
    path.write_text(json.dumps({"keys": [{**public_jwk(KEYS["ES256"], "ES256", "es256"), **change}]}))
    with pytest.raises(Unauthorized):
        caller_of(path, signed())


def test_a_token_without_a_key_id_needs_a_single_key(tmp_path: Path, key_file: Path):
    assert caller_of(key_file, signed(kid=None)).name == "jwt:robot-7"
    two = tmp_path / "two.json"
    two.write_text(json.dumps(key_set(a=(KEYS["ES256"], "ES256"), b=(OTHER, "ES256"))))
    with pytest.raises(Unauthorized):
        caller_of(two, signed(kid=None))


def test_an_rsa_key_is_used_for_its_algorithm_alone(tmp_path: Path):
    source = tmp_path / "jwks.json"
    source.write_text(json.dumps({"keys": [public_jwk(KEYS["RS256"], "RS256", "k") | {"alg": "RS512"}]}))
    assert caller_of(source, signed("RS512", KEYS["RS256"], "k"))
    with pytest.raises(Unauthorized):
        caller_of(source, signed("RS256", kid="k"))


def test_clocks_have_a_leeway(key_file: Path, monkeypatch: pytest.MonkeyPatch):
    assert caller_of(key_file, signed(exp=time.time() - 10))
    monkeypatch.setattr(token_verifier, "LEEWAY_S", 1.0)
    with pytest.raises(Unauthorized):
        caller_of(key_file, signed(exp=time.time() - 10))


@pytest.mark.parametrize(
    ("given", "scopes"),
    [
        ({"scope": "localize build"}, {Scope.LOCALIZE, Scope.BUILD}),
        ({"scope": None, "scp": ["admin"]}, {Scope.ADMIN}),
        ({"scope": None, "scp": "metrics"}, {Scope.METRICS}),
        ({"scope": "openid profile"}, set()),
        ({"scope": None}, set()),
        ({"scope": 7, "scp": {"a": 1}}, set()),
        ({"scope": "Admin admins"}, set()),
    ],
)
def test_the_scopes_of_a_token_are_granted(key_file: Path, given: dict[str, Any], scopes: set[Scope]):
    assert caller_of(key_file, signed(**given)).grant.scopes == scopes


def test_scopes_may_have_a_prefix(key_file: Path):
    token = signed(scope="firstfix:build admin")
    assert caller_of(key_file, token, jwt_scope_prefix="firstfix:").grant.scopes == {Scope.BUILD}


@pytest.mark.parametrize(
    ("claim", "seen"),
    [(["hall-*"], True), ("hall-* yard", True), (None, False), ([], False), ("HALL", False)],
)
def test_the_maps_of_a_token_are_granted(key_file: Path, claim: Any, seen: bool):
    caller = caller_of(key_file, signed(maps=claim), jwt_maps_claim="maps")
    assert caller.sees("hall-7") is seen
    assert not caller.sees("attic")


def test_a_subject_is_escaped(key_file: Path):
    assert caller_of(key_file, signed(sub="a\r\nb\x1b[31m")).name == r"jwt:a\r\nb\x1b[31m"


def test_tokens_need_an_issuer_and_an_audience(key_file: Path):
    for missing in ("jwt_issuer", "jwt_audience"):
        with pytest.raises(InvalidOption, match="FIRSTFIX_JWT"):
            TokenVerifier(settings(key_file, **{missing: None}))


def test_long_subjects_stay_distinct(key_file: Path):
    """Names are owners: two callers must not share one."""
    names = {caller_of(key_file, signed(sub="x" * 300 + end)).name for end in "ab"}
    assert len(names) == 2
    assert max(map(len, names)) < 300


@pytest.mark.parametrize(
    "url",
    ["http://login.example.org/keys", "ftp://login.example.org/keys", "https:///keys"]
    + ["https://user:secret@login.example.org/keys", "http://127.0.0.1.example.org/keys"],
)
def test_keys_are_fetched_over_https_alone(url: str):
    with pytest.raises(InvalidOption) as refused:
        Jwks(url)
    assert "secret@" not in str(refused.value)


@pytest.fixture
def issuer() -> Iterator[Issuer]:
    running = Issuer()
    yield running
    if running.gate is not None:
        running.gate.set()
    running.server.shutdown()
    running.server.server_close()


def test_a_new_key_of_the_issuer_is_fetched_but_seldom(issuer: Issuer):
    async def scenario() -> None:
        clock = Clock(1000.0)
        keys = Jwks(issuer.url, clock)
        assert await keys.key("es256", "ES256")
        assert issuer.asked == 1
        issuer.document = key_set(new=(OTHER, "ES256"))
        for _ in range(5):
            with pytest.raises(Unauthorized):
                await keys.key("new", "ES256")
        assert issuer.asked == 1, "made-up key ids do not make this service a flood"
        clock.now += 10.0
        assert await keys.key("new", "ES256")
        with pytest.raises(Unauthorized):
            await keys.key("es256", "ES256")
        assert issuer.asked == 2

    asyncio.run(scenario())


def test_concurrent_callers_wait_for_one_fetch(issuer: Issuer):
    async def scenario() -> None:
        issuer.gate = threading.Event()
        keys = Jwks(issuer.url)
        waiting = [asyncio.create_task(keys.key("es256", "ES256")) for _ in range(20)]
        await wait_until_async(lambda: issuer.asked)
        issuer.gate.set()
        assert all(await asyncio.gather(*waiting))
        assert issuer.asked == 1

    asyncio.run(scenario())


BAD_ANSWERS: dict[str, dict[str, Any]] = {
    "status": {"status": 500},
    "redirect": {"status": 302, "headers": {"Location": "http://127.0.0.1:1/"}},
    "not json": {"document": b"<html>"},
    "no set": {"document": {"keys": {}}},
    "a list": {"document": []},
    "deep": {"document": b"[" * 100_000},
    "endless": {"document": b" " * 300_000},
    "too many keys": {"document": {"keys": [{}] * 101}},
    "a secret": {"document": {"keys": [{"kty": "oct", "k": "c2VjcmV0", "kid": "es256"}]}},
}


@pytest.mark.parametrize("case", BAD_ANSWERS)
def test_an_invalid_answer_of_the_issuer_keeps_the_keys(issuer: Issuer, case: str):
    async def scenario() -> None:
        keys = Jwks(issuer.url)
        await keys.refresh()
        vars(issuer).update(BAD_ANSWERS[case])
        await keys.refresh()
        assert issuer.asked == 2
        assert await keys.key("es256", "ES256")
        fresh = Jwks(issuer.url)
        with pytest.raises(Overloaded):
            await fresh.key("es256", "ES256")

    asyncio.run(scenario())


def test_keys_of_an_unreachable_issuer_are_used_for_a_day(issuer: Issuer):
    async def scenario() -> None:
        clock = Clock(1000.0)
        keys = Jwks(issuer.url, clock)
        await keys.refresh()
        issuer.status = 503
        clock.now += jwks_module.MAX_AGE_S - 1
        assert await keys.key("es256", "ES256")
        clock.now += 2
        with pytest.raises(Overloaded):
            await keys.key("es256", "ES256")

    asyncio.run(scenario())


def test_a_hanging_issuer_is_given_up(issuer: Issuer, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(jwks_module, "_TIMEOUT_S", 0.2)
    issuer.gate = threading.Event()

    async def scenario() -> None:
        with pytest.raises(FirstfixError):
            await Jwks(issuer.url).key("es256", "ES256")

    asyncio.run(scenario())


def test_a_service_takes_tokens_and_keys_side_by_side(tmp_path: Path, issuer: Issuer):
    chosen = {"jwt_jwks": issuer.url, "jwt_issuer": ISSUER, "jwt_audience": AUDIENCE, "auth": "on"}
    with running_service(tmp_path, **chosen, jwt_maps_claim="maps", zenoh=False) as service:
        publish(service.catalog, "hall", "1", service.scratch)

        def status(token: str, path: str = "/maps/hall") -> int:
            return service.http.get(path, headers={"Authorization": f"Bearer {token}"}).status_code

        wait_until(lambda: status(signed(maps="hall")) == 200)
        assert status(signed(maps="yard")) == 403
        assert status(signed(maps="hall"), "/metrics") == 403
        assert status(signed(maps="hall", scope="openid")) == 403
        assert status(signed(maps="hall", key=OTHER)) == 401
        assert status("ffx_0123456789ab_" + "0" * 64) == 401
