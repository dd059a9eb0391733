"""One answer as an event: CloudEvents 1.0 in JSON, signed as Standard Webhooks 1.0 has it."""

from __future__ import annotations

import base64
import binascii
import hmac
import uuid
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime, timezone
from pathlib import Path

import orjson

from firstfix.errors import InvalidOption

from ..query_workers.query import EncodedAnswer

MEDIA_TYPE = "application/cloudevents+json; charset=utf-8"
TYPE = "firstfix.localization."  # and the verdict
PREFIX = "whsec_"
MIN_SECRET_BYTES, MAX_SECRET_BYTES = 24, 64  # as the standard says
MAX_FILE_BYTES = 4096


@dataclass(frozen=True)
class AnswerEvent:
    """One answer.

    Attributes:
        source: URI reference of the replica that gave it.
        caller: name of who asked.
        seconds: from the query's arrival to its answer.
        event_id: the same in every attempt: a receiver that has seen it ignores the event.
    """

    answer: EncodedAnswer
    source: str
    caller: str
    transport: str
    seconds: float
    request_id: str
    event_id: str = field(default_factory=lambda: str(uuid.uuid4()))
    time: datetime = field(default_factory=lambda: datetime.now(timezone.utc))

    def body(self) -> bytes:
        """The event in JSON; its data has the whole answer as the caller got it."""
        return orjson.dumps(
            {
                "specversion": "1.0",
                "id": self.event_id,
                "source": self.source,
                "type": TYPE + self.answer.verdict.value,
                "subject": self.answer.map_id,
                "time": self.time.isoformat(timespec="milliseconds").replace("+00:00", "Z"),
                "datacontenttype": "application/json",
                "data": {
                    "request_id": self.request_id,
                    "caller": self.caller,
                    "transport": self.transport,
                    "seconds": round(self.seconds, 4),
                    "answer": orjson.Fragment(self.answer.json),
                },
            }
        )


def signed_headers(event_id: str, body: bytes, secrets: Sequence[bytes], now_s: int) -> dict[str, str]:
    """The headers of one attempt: HMAC-SHA256 over id, time and body, by each of the secrets.

    Args:
        now_s: seconds since the epoch. A receiver refuses an old one, so nobody can send it again later.
    """
    signed = f"{event_id}.{now_s}.".encode() + body
    signatures = (base64.b64encode(hmac.digest(one, signed, "sha256")).decode() for one in secrets)
    return {
        "Content-Type": MEDIA_TYPE,
        "webhook-id": event_id,
        "webhook-timestamp": str(now_s),
        "webhook-signature": " ".join(f"v1,{one}" for one in signatures),
    }


def read_secrets(file: Path) -> tuple[bytes, ...]:
    """The secrets of a file, one a line: ``whsec_`` and 24 to 64 bytes in base64.

    Two of them while a receiver changes from one to the other.

    Raises:
        InvalidOption: the file cannot be read, or is not such a file.
    """
    try:
        with file.open("rb") as opened:
            text = opened.read(MAX_FILE_BYTES + 1)
    except OSError as error:
        raise InvalidOption(f"FIRSTFIX_WEBHOOK_SECRET_FILE: {error}") from None
    lines = text.split() if len(text) <= MAX_FILE_BYTES else []
    try:
        secrets = tuple(base64.b64decode(line.removeprefix(PREFIX.encode()), validate=True) for line in lines)
    except binascii.Error:
        secrets = ()
    if not secrets or not all(MIN_SECRET_BYTES <= len(one) <= MAX_SECRET_BYTES for one in secrets):
        raise InvalidOption(
            f"FIRSTFIX_WEBHOOK_SECRET_FILE: {file} must have one secret a line, {PREFIX} and "
            f"{MIN_SECRET_BYTES} to {MAX_SECRET_BYTES} random bytes in base64"
        )
    return secrets
