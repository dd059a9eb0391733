"""Address of the NATS server and credentials for it, from the settings. Secrets are in files only."""

from __future__ import annotations

import importlib.util
import re
import ssl
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from firstfix.errors import InvalidOption

from ...settings import Settings

DEFAULT_NAME = "firstfix"
_NAME = re.compile(r"[a-z0-9][a-z0-9_-]{0,31}")
_MAX_CREDENTIALS_BYTES = 64 << 10


@dataclass(frozen=True)
class NatsAddress:
    """Address and credentials.

    Attributes:
        url: has no secrets and may be logged.
        name: of the streams. Deployments that share a NATS server need different names.
        credentials: file that is read when it is needed.
    """

    url: str
    name: str
    credentials: Path | None
    ca: Path | None
    certificate: Path | None

    @classmethod
    def of(cls, settings: Settings) -> NatsAddress:
        """The address in the settings.

        Raises:
            InvalidOption: the URL does not have the form tls://host:4222/name.
        """
        try:
            parts = urlsplit(settings.build_queue)
            port = parts.port or 4222
        except ValueError as error:
            raise InvalidOption(f"build queue: {error}") from None
        name = parts.path.strip("/") or DEFAULT_NAME
        if not parts.hostname or parts.query or parts.fragment or not _NAME.fullmatch(name):
            raise InvalidOption(
                "build queue: must be nats://host:4222 or tls://host:4222, with optional /name of a-z 0-9 _ -"
            )
        host = f"[{parts.hostname}]" if ":" in parts.hostname else parts.hostname
        return cls(
            f"{parts.scheme}://{host}:{port}",
            name,
            settings.nats_credentials,
            settings.nats_ca,
            settings.nats_certificate,
        )

    def options(self) -> dict[str, Any]:
        """The options for ``nats.connect``.

        Raises:
            InvalidOption: a file is missing or malformed.
        """
        try:
            return {**self._tls(), **self._identity()}
        except ssl.SSLError as error:
            raise InvalidOption(f"NATS certificates: {error.reason}") from None
        except OSError as error:
            raise InvalidOption(f"NATS: {error.filename}: {error.strerror}") from None

    def _tls(self) -> dict[str, Any]:
        if not (self.url.startswith("tls://") or self.ca or self.certificate):
            return {}
        context = ssl.create_default_context(cafile=None if self.ca is None else str(self.ca))
        if self.certificate is not None:
            context.load_cert_chain(self.certificate)
        return {"tls": context}

    def _identity(self) -> dict[str, Any]:
        if self.credentials is None:
            return {}
        with self.credentials.open("rb") as file:
            text = file.read(_MAX_CREDENTIALS_BYTES).decode("utf-8", errors="replace").strip()
        if "BEGIN NATS USER JWT" in text:
            if importlib.util.find_spec("nkeys") is None:
                raise InvalidOption("a .creds file for NATS needs the package nkeys")
            return {"user_credentials": str(self.credentials)}
        if not text or len(text.splitlines()) != 1:
            raise InvalidOption(
                "the NATS credentials must be a .creds file, or one line with user:password or a token"
            )
        user, colon, password = text.partition(":")
        return {"user": user, "password": password} if colon else {"token": text}
