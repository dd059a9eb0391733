"""A token issuer on loopback, and its tokens."""

from __future__ import annotations

import json
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import jwt
from cryptography.hazmat.primitives.asymmetric import ec, ed25519, rsa

from firstfix_service.settings import Settings
from tests.waiting import LIMIT_S

ISSUER, AUDIENCE = "https://login.example.org/", "firstfix"
KEYS: dict[str, Any] = {
    "RS256": rsa.generate_private_key(public_exponent=65537, key_size=2048),
    "ES256": ec.generate_private_key(ec.SECP256R1()),
    "EdDSA": ed25519.Ed25519PrivateKey.generate(),
}
OTHER = ec.generate_private_key(ec.SECP256R1())
SHORT = rsa.generate_private_key(public_exponent=65537, key_size=1024)


def public_jwk(key: Any, algorithm: str, key_id: str) -> dict[str, Any]:
    made = jwt.get_algorithm_by_name(algorithm).to_jwk(key.public_key(), as_dict=True)
    return {**made, "kid": key_id, "use": "sig"}


def key_set(**keys: tuple[Any, str]) -> dict[str, Any]:
    return {"keys": [public_jwk(key, algorithm, name) for name, (key, algorithm) in keys.items()]}


ALL_KEYS = key_set(**{name.lower(): (key, name) for name, key in KEYS.items()})


def claims(**changes: Any) -> dict[str, Any]:
    made = {
        "iss": ISSUER,
        "aud": AUDIENCE,
        "sub": "robot-7",
        "exp": time.time() + 300,
        "scope": "openid localize",
        **changes,
    }
    return {name: value for name, value in made.items() if value is not None}


def signed(algorithm: str = "ES256", key: Any = None, kid: str | None = "", **changes: Any) -> str:
    headers = {"kid": algorithm.lower() if kid == "" else kid}
    return jwt.encode(
        claims(**changes), key or KEYS[algorithm], algorithm, headers=headers if kid is not None else None
    )


def settings(source: Path | str, **changes: Any) -> Settings:
    values = {"jwt_jwks": str(source), "jwt_issuer": ISSUER, "jwt_audience": AUDIENCE, **changes}
    return Settings(store="memory://", auth="on", **values)


class Issuer:
    """Serves a JWK set on loopback."""

    def __init__(self) -> None:
        self.document: Any = ALL_KEYS
        self.status = 200
        self.headers: dict[str, str] = {}
        self.asked = 0
        self.gate: threading.Event | None = None
        issuer = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                issuer.asked += 1
                if issuer.gate is not None:
                    issuer.gate.wait(LIMIT_S)
                body = issuer.document
                data = body if isinstance(body, bytes) else json.dumps(body).encode()
                self.send_response(issuer.status)
                for name, value in issuer.headers.items():
                    self.send_header(name, value)
                self.end_headers()
                self.wfile.write(data)

            def log_message(self, *_: Any) -> None: ...

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_port}/keys"
        threading.Thread(target=self.server.serve_forever, daemon=True).start()
