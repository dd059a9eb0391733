from __future__ import annotations

import json

import pytest

from firstfix.redact import HIDDEN, redact, redactor

KEY = f"ffx_0123456789ab_{'5e' * 32}"
JWT = "eyJhbGciOiJFUzI1NiJ9.eyJzdWIiOiJyb2JvdCJ9.c2lnbmF0dXJl-_A"


@pytest.mark.parametrize(
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


def test_the_rest_is_left():
    assert redact(f"key {KEY} of hall") == "key ffx_0123456789ab_*** of hall"
    assert redact("https://user:hunter2@host/path?a=1") == "https://***@host/path?a=1"
    for text in (
        "no map hall",
        "https://host/path?a=1&b=2",
        "3 tokens; signature of the key",
        "store s3://bucket/prefix?region=eu",
        "build 20300101t000000000000-0123abcd",
        "version " + "0123456789abcdef" * 4,
        "two@places",
    ):
        assert redact(text) == text


def test_json_stays_json():
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


@pytest.mark.timeout(600)
@pytest.mark.parametrize(
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
def test_a_long_line_costs_no_more_than_its_length(line: str):
    assert redact(line)[:2] == line[:2]  # with a quadratic pattern a megabyte takes hours


def test_a_secret_that_is_not_there_leaves_json_as_it_is():
    line = json.dumps({"nats_credentials": None, "token": None, "password": "abc12345"})
    assert json.loads(redact(line)) == {"nats_credentials": None, "token": None, "password": HIDDEN}
