"""Security of zenoh: signatures of queries and replies, and endpoints that others can reach or read along."""

from __future__ import annotations

import dataclasses
import hashlib
import json

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from firstfix.wire.endpoints import SCOUTING, Links, is_encrypted_endpoint, is_local_endpoint
from firstfix.wire.signature import REPLY_MARK, SIGNATURE_BYTES, Asked, QuerySignature, SigningKey

API_KEY = "ffx_0123456789ab_" + "c3" * 32
KEY = SigningKey.of_api_key(API_KEY)
assert KEY is not None
ASKED = Asked.of("firstfix/hall/localize/r1", [("gravity", "0,0,-1"), ("deadline_ms", "9000")], "a/b")
BODY = b"a scan"
SIGNATURE = KEY.sign(ASKED, BODY, 1_700_000_000_000, bytes(range(16)))


def test_both_sides_derive_the_same_keys():
    of_store = SigningKey.of_hash("0123456789ab", hashlib.sha256(("c3" * 32).encode()).digest())
    assert of_store == KEY
    assert of_store.query_key != of_store.answer_key
    assert of_store.query_key.hex() not in repr(of_store)


@pytest.mark.parametrize("other", ["", "eyJhbGciOi.e30.x", API_KEY + "0", API_KEY.upper(), "\nffx_"])
def test_other_credentials_have_no_signing_key(other: str):
    assert SigningKey.of_api_key(other) is None


def test_a_signature_comes_back():
    sent = SIGNATURE.to_bytes()
    assert len(sent) == SIGNATURE_BYTES == 104
    assert QuerySignature.parse(sent) == SIGNATURE
    assert KEY.has_signed(SIGNATURE, ASKED)
    assert SIGNATURE.fits(BODY)
    assert b"c3c3" not in sent


@pytest.mark.parametrize(
    "other",
    [
        dataclasses.replace(ASKED, key="firstfix/yard/localize/r1"),
        dataclasses.replace(ASKED, key="firstfix/hall/localize"),
        dataclasses.replace(ASKED, parameters=()),
        dataclasses.replace(ASKED, parameters=(*ASKED.parameters, ("version", ""))),
        dataclasses.replace(ASKED, parameters=(("deadline_ms", "90"), ("00gravity", "0,0,-1"))),
        dataclasses.replace(ASKED, encoding="a/c"),
        Asked("firstfix/hall/localize/r1a/b", ASKED.parameters, ""),
    ],
)
def test_a_signature_fits_one_query_alone(other: Asked):
    assert not KEY.has_signed(SIGNATURE, other)


def test_the_order_of_parameters_and_zenohs_own_are_no_part():
    shuffled = Asked.of(ASKED.key, [("deadline_ms", "9000"), ("_anyke", ""), ("gravity", "0,0,-1")], "a/b")
    assert KEY.has_signed(SIGNATURE, shuffled)


def test_a_flipped_bit_breaks_a_signature():
    sent = SIGNATURE.to_bytes()
    for bit in range(8 * len(sent)):
        changed = bytearray(sent)
        changed[bit // 8] ^= 1 << bit % 8
        parsed = QuerySignature.parse(bytes(changed))
        assert parsed is None or not KEY.has_signed(parsed, ASKED), bit
    assert not SIGNATURE.fits(BODY + b"\0")


@given(st.binary(max_size=200))
def test_other_bytes_are_no_signature(attachment: bytes):
    parsed = QuerySignature.parse(attachment)
    assert parsed is None or not KEY.has_signed(parsed, ASKED)


def test_a_reply_fits_one_query_one_kind_and_one_content():
    signed = KEY.signed_encoding(SIGNATURE, True, "application/cdr;a/b", b"pose")
    assert signed.startswith("application/cdr;a/b" + REPLY_MARK)
    assert KEY.has_replied(SIGNATURE, True, signed, b"pose")
    again = KEY.sign(ASKED, BODY, SIGNATURE.time_ms, bytes(16))
    other = SigningKey.of_api_key("ffx_0123456789ab_" + "c4" * 32)
    assert other is not None
    assert not KEY.has_replied(again, True, signed, b"pose")
    assert not KEY.has_replied(SIGNATURE, False, signed, b"pose")
    assert not KEY.has_replied(SIGNATURE, True, signed, b"pope")
    assert not KEY.has_replied(SIGNATURE, True, signed.replace("a/b", "a/c"), b"pose")
    assert not other.has_replied(SIGNATURE, True, signed, b"pose")
    for wrong in ("", "application/json", REPLY_MARK, signed[:-1], signed + "0", signed.upper()):
        assert not KEY.has_replied(SIGNATURE, True, wrong, b"pose")


def test_a_querys_signature_is_no_replys():
    """A query's signature is no reply's, though both come from one API key."""
    assert not KEY.has_replied(SIGNATURE, True, f"a/b{REPLY_MARK}{SIGNATURE.mac.hex()}", BODY)


@pytest.mark.parametrize(
    ("endpoint", "is_local", "is_encrypted"),
    [
        ("tcp/127.0.0.1:7447", True, False),
        ("tcp/[::1]:7447?prio=1#iface=lo", True, False),
        ("unixsock-stream//run/a.sock", True, False),
        ("tcp/0.0.0.0:7447", False, False),
        ("tcp/localhost.evil.example:7447", False, False),
        ("tls/192.0.2.1:7447", False, True),
        ("quic/robot.example:7447", False, True),
        ("tlsx/robot.example:7447", False, False),
        ("", False, False),
        (SCOUTING, False, False),
    ],
)
def test_endpoints_are_local_and_encrypted_by_their_form(endpoint: str, is_local: bool, is_encrypted: bool):
    assert is_local_endpoint(endpoint) is is_local
    assert is_encrypted_endpoint(endpoint) is is_encrypted


def links(**given: object) -> Links:
    config = zenoh.Config()
    for name, value in given.items():
        config.insert_json5(name.replace("__", "/"), json.dumps(value))
    return Links.of(config)


def test_a_configuration_without_endpoints_is_open():
    assert links() == Links(("tcp/[::]:0",), (SCOUTING,))
    assert links(mode="router").listens == ("tcp/[::]:7447",)
    assert links(mode="client", scouting__multicast__enabled=False) == Links((), ())


def test_endpoints_of_its_mode_count():
    quiet = {"scouting__multicast__enabled": False}
    found = links(
        mode="peer", listen__endpoints={"peer": ["tcp/127.0.0.1:1"], "router": ["tcp/0:1"]}, **quiet
    )
    assert found.beyond == []
    assert found.are_encrypted
    mixed = links(listen__endpoints=[], connect__endpoints=["tls/a:1", "tcp/b:1"], **quiet)
    assert mixed.beyond == ["tls/a:1", "tcp/b:1"]
    assert not mixed.are_encrypted
