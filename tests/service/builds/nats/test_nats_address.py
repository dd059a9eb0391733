"""Address of NATS: the URL has no secret, and secrets come from files only."""

from __future__ import annotations

from pathlib import Path

import pytest
from pydantic import ValidationError

from firstfix.errors import InvalidOption
from firstfix_service.builds.nats.address import NatsAddress
from firstfix_service.settings import Settings


def address(url: str, **changes: Path) -> NatsAddress:
    return NatsAddress.of(Settings(store="memory://", build_queue=url, **changes))


@pytest.mark.parametrize(
    ("url", "server", "name"),
    [
        ("nats://host", "nats://host:4222", "firstfix"),
        ("tls://host:4333/site-2", "tls://host:4333", "site-2"),
        ("nats://[::1]:4222/", "nats://[::1]:4222", "firstfix"),
    ],
)
def test_an_address_is_parsed(url: str, server: str, name: str):
    assert (address(url).url, address(url).name) == (server, name)


@pytest.mark.parametrize("url", ["nats://user:secret@host", "http://h", "nats://", "elsewhere", "nats://a b"])
def test_an_invalid_url_is_refused_with_the_settings(url: str):
    with pytest.raises(ValidationError):
        address(url)


@pytest.mark.parametrize("url", ["nats://host:0x1", "nats://host/Big", "nats://host/a/b", "nats://host?x=1"])
def test_a_url_of_another_form_is_refused(url: str):
    with pytest.raises(InvalidOption, match="build queue"):
        address(url)


@pytest.mark.parametrize(
    ("content", "options"),
    [
        ("user:pass:word\n", {"user": "user", "password": "pass:word"}),
        ("a-token", {"token": "a-token"}),
    ],
)
def test_the_login_is_read_from_a_file(tmp_path: Path, content: str, options: dict[str, str]):
    (tmp_path / "login").write_text(content)
    assert address("nats://host", nats_credentials=tmp_path / "login").options() == options
    assert "pass" not in repr(address("nats://host", nats_credentials=tmp_path / "login"))


@pytest.mark.parametrize("content", ["", "a\nb\n"])
def test_an_invalid_login_file_is_refused(tmp_path: Path, content: str):
    (tmp_path / "login").write_text(content)
    with pytest.raises(InvalidOption, match="one line"):
        address("nats://host", nats_credentials=tmp_path / "login").options()


def test_errors_name_the_missing_files(tmp_path: Path):
    for name in ("nats_credentials", "nats_ca", "nats_certificate"):
        with pytest.raises(InvalidOption, match="NATS"):
            address("tls://host", **{name: tmp_path / "none"}).options()


def test_tls_follows_from_the_url_or_its_authorities():
    assert address("nats://host").options() == {}
    assert set(address("tls://host").options()) == {"tls"}
