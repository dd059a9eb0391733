"""What is hidden in logs and messages, and the trace that a request belongs to."""

from __future__ import annotations

import ast
import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firstfix.telemetry.redact import _PATTERNS, HIDDEN, redact, redactor
from firstfix.telemetry.trace_context import TraceContext, is_tracing_wanted
from tests.every_case import every_case

KEY = f"ffx_0123456789ab_{'5e' * 32}"
JWT = "eyJhbGciOiJFUzI1NiJ9.eyJzdWIiOiJyb2JvdCJ9.c2lnbmF0dXJl-_A"


@every_case(
    ("text", "secret"),
    [
        (f"a key {KEY} in a sentence", "5e5e"),
        (f"a key cut short {KEY[:40]}", "5e5e"),
        (f"Authorization: Bearer {KEY}", "5e5e"),
        (f"authorization=Bearer {JWT}", "c2ln"),
        (f"a token {JWT}", "c2ln"),
        ("Authorization: ApiKey hunter2-hunter2", "hunter2"),
        ("[(b'Authorization', b'Basic dXNlcjpodW50ZXIy')]", "dXNlcj"),
        ("proxy: Basic dXNlcjpodW50ZXIy", "dXNlcj"),
        ("GET https://user:hunter2@host/path", "hunter2"),
        ("https://user:hun/ter2@host/path is no URL", "ter2"),
        ("nats://hunter2@host:4222", "hunter2"),
        ("https://host/x?X-Amz-Signature=abcdef&X-Amz-Date=1", "abcdef"),
        ("https://acct.blob/x?sv=1&sig=abc%2Fdef%3D", "abc%2F"),
        ("?api_key=hunter2", "hunter2"),
        ("AWS_SECRET_ACCESS_KEY=wJalrXUtnFEMI/K7MDENG/bPxRfiCYEXAMPLEKEY", "wJalr"),
        ('{"aws_secret_access_key": "wJalrXUtnFEMI"}', "wJalr"),
        ("password: hunter2", "hunter2"),
        (r'{"text": "{\"password\": \"hunter2\"}"}', "hunter2"),
    ],
)
def test_a_secret_is_hidden(text: str, secret: str):
    shown = redact(text)
    assert secret not in shown
    assert "***" in shown


WORDS = "http://u:p@h/ s3://a:b/c@ passwd=x SIGnature='ab' \u017fecret=abcd toKen= sig=1 = \" \\ é"
PIECES = [
    KEY,
    JWT,
    "Authorization: Basic",
    "bearer  01234567",
    "cooKie: k",
    "api-key: q",
    ": ",
    *WORDS.split(),
]


@given(st.lists(st.sampled_from(PIECES), max_size=8).map("".join))
def test_every_pattern_has_its_word(text: str):
    every = text
    for _, pattern, shown in _PATTERNS:
        every = pattern.sub(shown, every)
    assert redact(text) == every


UNTOUCHED = [
    "no map hall",
    "https://host/path?a=1&b=2",
    "3 tokens; signature of the key",
    "store s3://bucket/prefix?region=eu",
    "build 20300101t000000000000-0123abcd",
    "version " + "0123456789abcdef" * 4,
    "two@places",
    "s3://bucket/scans/hall@2.laz is no map",
    "https://host:8080/hall@2.laz is no map",
    "https://host/x?by=me@example.org",
    "a credential comes in one header Authorization, after the word Bearer",
]


@every_case(
    ("text", "shown"),
    [
        (f"key {KEY} of hall", "key ffx_0123456789ab_*** of hall"),
        ("https://user:hunter2@host/path?a=1", "https://***@host/path?a=1"),
        (
            f"header Authorization: Bearer {KEY} is not for map hall",
            "header Authorization: *** is not for map hall",
        ),
        ("(b'authorization', b'ApiKey a b'), (b'host', b'x')", "(b'authorization', b'***'), (b'host', b'x')"),
        ("password=***hunter2 of hall", "password=*** of hall"),
        *((text, text) for text in UNTOUCHED),
    ],
)
def test_nothing_but_the_secret_is_hidden(text: str, shown: str):
    assert redact(text) == shown


def test_redacted_json_is_json():
    event = {
        "event": f'say "{KEY}"',
        "header": f"Bearer {JWT}",
        "authorization": f"Bearer {KEY}",
        "password": 'with " quote',
        "url": "https://user:hunter2@host",
        "n": 3,
        "token": "hunter2hunter2",
    }
    shown = json.loads(redact(json.dumps(event)))
    assert set(shown) == set(event)
    assert shown["n"] == 3
    assert shown["authorization"] == shown["token"] == "***"
    line = json.dumps({"nats_credentials": None, "token": None, "password": "abc12345"})
    assert json.loads(redact(line)) == {"nats_credentials": None, "token": None, "password": HIDDEN}


def test_values_of_the_environment_are_hidden_whatever_their_form():
    environment = {
        "AWS_SECRET_ACCESS_KEY": 'odd "value" with spaces',
        "AWS_ACCESS_KEY_ID": "AKIAIOSFODNN7EXAMPLE",
        "AZURE_STORAGE_ACCOUNT_KEY": "abcdefgh",
        "MY_PASSWORD": "short",
        "HOME": "/home/robot",
    }
    hide = redactor(environment)
    text = json.dumps({"x": environment["AWS_SECRET_ACCESS_KEY"]}) + " abcdefgh /home/robot short"
    assert hide(text) == '{"x": "***"} *** /home/robot short'
    assert redactor({})("nothing to hide") == "nothing to hide"


def test_paths_and_queries_of_urls_are_hidden_and_their_hosts_stay():
    urls = [
        "https://fleet.example/hooks/T01/secret?x=1",
        "https://short.example/ab",
        "https://odd.example/a b/ü",
        "https://plain.example/",
        "https://[bad/secret",
    ]
    hide = redactor({}, urls)
    cases = {
        "POST https://fleet.example/hooks/T01/secret?x=1 307": "POST https://fleet.example*** 307",
        "target b'/hooks/T01/secret?x=1'": "target b'***'",
        "https://short.example/ab and /ab": "https://*** and /ab",
        "https://odd.example/a b/ü": "https://***",
        "https://odd.example/a%20b/%C3%BC": "https://odd.example***",
        "https://plain.example/ and /": "https://plain.example/ and /",
        "no https://[bad/secret": "no ***",
    }
    assert {text: hide(text) for text in cases} == cases


def test_the_path_of_a_collector_is_hidden_but_for_the_usual_one():
    hide = redactor({"OTEL_EXPORTER_OTLP_ENDPOINT": "https://c.example/otlp/secret"})
    assert hide("url: /otlp/secret/v1/traces") == "url: ***/v1/traces"
    usual = "http://c.example:4318/v1/traces: url: /v1/traces"
    assert redactor({"OTEL_EXPORTER_OTLP_TRACES_ENDPOINT": "http://c.example:4318/v1/traces"})(usual) == usual


@pytest.mark.timeout(600)
@every_case(
    "line",
    [
        "a-" * 500_000,
        "eyJ-" * 250_000,
        "eyJaaaa" * 150_000,
        "a://" * 250_000,
        "token " * 200_000,
        "token" + " " * 1_000_000,
        "Bearer " * 150_000,
        "authorization=" * 75_000,
        "ffx_0123456789ab_" * 60_000,
    ],
    ids=lambda line: line[:12],
)
def test_redacting_takes_linear_time(line: str):
    assert redact(line)[:2] == line[:2]  # with a quadratic pattern a megabyte takes hours


def test_a_message_names_the_file_that_a_secret_is_in():
    places = {
        "FIRSTFIX_NATS_CREDENTIALS": "/run/firstfix/nats",
        "GOOGLE_APPLICATION_CREDENTIALS": "/run/gcp/key.json",
        "AWS_SHARED_CREDENTIALS_FILE": "/run/aws/credentials",
        "AWS_WEB_IDENTITY_TOKEN_FILE": "/run/aws/token",
    }
    message = f"no file {', '.join(places.values())}"
    assert redactor(places)(message) == message


ROOT = Path(__file__).parents[3]
FILL = "hall-2"


def messages() -> Iterator[str]:
    """Every text that an error is raised with or that is logged, its gaps filled with a harmless word."""
    for package in ("core", "service", "builder", "cli"):
        for path in sorted((ROOT / package).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.Call):
                    for one in (*node.args, *(keyword.value for keyword in node.keywords)):
                        if isinstance(one, ast.JoinedStr):
                            parts = (
                                part.value if isinstance(part, ast.Constant) else FILL for part in one.values
                            )
                            yield "".join(map(str, parts))
                        elif isinstance(one, ast.Constant) and isinstance(one.value, str):
                            yield one.value


def test_no_message_of_ours_is_redacted():
    ours = {text for text in messages() if " " in text}
    assert len(ours) > 500
    assert {text: redact(text) for text in ours if redact(text) != text} == {}


PARTS = """token Password authorization sig credentials Bearer Basic eyJ ffx_0123456789ab_ b' :// *** null a
    hunter2 abcdefgh 8080 user h 5e5e5e5e5e5e5e5e"""


@given(
    st.lists(st.sampled_from([*PARTS.split(), *":=, '\"\\@/.-*\n&?;(){}", "  "]), max_size=24).map("".join)
)
def test_redacting_twice_changes_nothing(text: str):
    once = redact(text)
    assert redact(once) == once


SENTENCE = "the map hall (2) was asked for a token, build; 404"
SECRETS = {
    KEY: "ffx_0123456789ab_***",
    JWT: "***",
    f"Authorization: Bearer {KEY}": "Authorization: ***",
    f"authorization=Bearer {JWT}": "authorization=***",
    "Basic dXNlcjpodW50ZXIy": "Basic ***",
    "https://user:hunter2@host/x": "https://***@host/x",
    "password=hunter2": "password=***",
    '"token": "hunter2"': '"token": "***"',
}


@given(*[st.lists(st.sampled_from(SENTENCE.split()))] * 2, st.sampled_from(sorted(SECRETS)))
def test_text_around_a_secret_stays(before: list[str], after: list[str], secret: str):
    assert redact(" ".join([*before, secret, *after])) == " ".join([*before, SECRETS[secret], *after])


TRACE, SPAN = "4bf92f3577b34da6a3ce929d0e0e4736", "00f067aa0ba902b7"


@every_case(("flags", "sampled"), [("01", True), ("00", False), ("03", True), ("02", False)])
def test_a_traceparent_is_read(flags: str, sampled: bool):
    found = TraceContext.parse(f"00-{TRACE}-{SPAN}-{flags}")
    assert found == TraceContext(TRACE, SPAN, sampled)
    assert found is not None
    assert found.traceparent == f"00-{TRACE}-{SPAN}-0{int(sampled)}"
    assert TraceContext.parse(found.traceparent) == found


def test_a_later_version_of_a_traceparent_is_read():
    assert TraceContext.parse(f"cc-{TRACE}-{SPAN}-01-more") == TraceContext(TRACE, SPAN, True)


@every_case(
    "bad",
    [
        None,
        "",
        "nonsense",
        f"ff-{TRACE}-{SPAN}-01",
        f"00-{TRACE}-{SPAN}-01-more",
        f"00-{TRACE.upper()}-{SPAN}-01",
        f"00-{'0' * 32}-{SPAN}-01",
        f"00-{TRACE}-{'0' * 16}-01",
        f"00-{TRACE}-{SPAN}-1",
        f"00-{TRACE}-{SPAN}",
    ],
)
def test_an_invalid_traceparent_is_none(bad: str | None):
    assert TraceContext.parse(bad) is None


@every_case(
    ("environ", "wanted"),
    [
        ({}, False),
        ({"OTEL_EXPORTER_OTLP_ENDPOINT": "http://localhost:4318"}, True),
        ({"OTEL_EXPORTER_OTLP_TRACES_ENDPOINT": "http://localhost:4318/v1/traces"}, True),
        ({"OTEL_EXPORTER_OTLP_ENDPOINT": "http://localhost:4318", "OTEL_SDK_DISABLED": "True"}, False),
        ({"OTEL_EXPORTER_OTLP_ENDPOINT": "http://localhost:4318", "OTEL_TRACES_EXPORTER": "none"}, False),
        ({"OTEL_EXPORTER_OTLP_ENDPOINT": "http://localhost:4318", "OTEL_TRACES_EXPORTER": "otlp"}, True),
    ],
)
def test_opentelemetrys_own_variables_decide(environ: dict[str, str], wanted: bool):
    assert is_tracing_wanted(environ) is wanted
