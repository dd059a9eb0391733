"""JSON Web Tokens: their permissions, and attempts to forge them."""

from __future__ import annotations

import asyncio
import base64
import hashlib
import hmac
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jwt
import pytest
from cryptography.hazmat.primitives import serialization

from firstfix.access.permissions import Scope
from firstfix.errors import InvalidOption, Unauthorized
from firstfix_service.auth import token_verifier
from firstfix_service.auth.principal import Principal
from firstfix_service.auth.token_verifier import TokenVerifier
from tests.service.token_world import (
    ALL_KEYS,
    KEYS,
    OTHER,
    SHORT,
    claims,
    key_set,
    public_jwk,
    settings,
    signed,
)


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
def test_what_is_refused(key_file: Path, case: str):
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
def test_a_public_key_is_no_secret_to_sign_with(key_file: Path, kind: str):
    """A known attack: HMAC with the bytes of the public key."""
    public = KEYS[kind].public_key()
    for encoding in (serialization.Encoding.PEM, serialization.Encoding.DER):
        secret = public.public_bytes(encoding, serialization.PublicFormat.SubjectPublicKeyInfo)
        body = f"{encoded({'alg': 'HS256', 'kid': kind.lower(), 'typ': 'JWT'})}.{encoded(claims())}"
        mac = hmac.new(secret, body.encode(), hashlib.sha256).digest()
        with pytest.raises(Unauthorized):
            caller_of(key_file, f"{body}.{encoded(mac)}")


def test_a_key_that_the_token_brings_along_is_not_looked_at(key_file: Path):
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
def test_a_short_rsa_key_proves_nothing(tmp_path: Path):
    path = tmp_path / "jwks.json"
    path.write_text(json.dumps(key_set(short=(SHORT, "RS256"))))
    with pytest.raises(Unauthorized):
        caller_of(path, signed("RS256", key=SHORT, kid="short"))


@pytest.mark.parametrize("change", [{"use": "enc"}, {"alg": "ES384"}, {"crv": "P-384"}, {"kty": "RSA"}])
def test_a_key_for_something_else_is_not_used(tmp_path: Path, change: dict[str, str]):
    path = tmp_path / "jwks.json"
    path.write_text(json.dumps({"keys": [{**public_jwk(KEYS["ES256"], "ES256", "es256"), **change}]}))
    with pytest.raises(Unauthorized):
        caller_of(path, signed())


def test_without_a_key_id_there_must_be_no_choice(tmp_path: Path, key_file: Path):
    assert caller_of(key_file, signed(kid=None)).name == "jwt:robot-7"
    two = tmp_path / "two.json"
    two.write_text(json.dumps(key_set(a=(KEYS["ES256"], "ES256"), b=(OTHER, "ES256"))))
    with pytest.raises(Unauthorized):
        caller_of(two, signed(kid=None))


def test_an_rsa_key_is_for_the_algorithm_that_it_names(tmp_path: Path):
    source = tmp_path / "jwks.json"
    source.write_text(json.dumps({"keys": [public_jwk(KEYS["RS256"], "RS256", "k") | {"alg": "RS512"}]}))
    assert caller_of(source, signed("RS512", KEYS["RS256"], "k"))
    with pytest.raises(Unauthorized):
        caller_of(source, signed("RS256", kid="k"))


def test_leeway_is_for_clocks(key_file: Path, monkeypatch: pytest.MonkeyPatch):
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
def test_scopes_of_a_token(key_file: Path, given: dict[str, Any], scopes: set[Scope]):
    assert caller_of(key_file, signed(**given)).grant.scopes == scopes


def test_scopes_under_a_prefix(key_file: Path):
    token = signed(scope="firstfix:build admin")
    assert caller_of(key_file, token, jwt_scope_prefix="firstfix:").grant.scopes == {Scope.BUILD}


@pytest.mark.parametrize(
    ("claim", "seen"),
    [(["hall-*"], True), ("hall-* yard", True), (None, False), ([], False), ("HALL", False)],
)
def test_maps_of_a_token(key_file: Path, claim: Any, seen: bool):
    caller = caller_of(key_file, signed(maps=claim), jwt_maps_claim="maps")
    assert caller.sees("hall-7") is seen
    assert not caller.sees("attic")


def test_a_subject_is_harmless_in_a_log(key_file: Path):
    assert caller_of(key_file, signed(sub="a\r\nb\x1b[31m")).name == r"jwt:a\r\nb\x1b[31m"


def test_tokens_need_an_issuer_and_an_audience(key_file: Path):
    for missing in ("jwt_issuer", "jwt_audience"):
        with pytest.raises(InvalidOption, match="FIRSTFIX_JWT"):
            TokenVerifier(settings(key_file, **{missing: None}))


def test_long_subjects_are_told_apart(key_file: Path):
    """Names are owners: two callers must not share one."""
    names = {caller_of(key_file, signed(sub="x" * 300 + end)).name for end in "ab"}
    assert len(names) == 2
    assert max(map(len, names)) < 300
