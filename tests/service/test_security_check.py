from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from structlog.testing import capture_logs

from firstfix.errors import InvalidOption
from firstfix.wire.endpoints import is_loopback
from firstfix_service.security_check import check_security, open_zenoh
from firstfix_service.settings import Settings
from tests.waiting import LIMIT_S

PUBLIC: list[dict[str, Any]] = [
    {"host": "0.0.0.0"},
    {"host": "::"},
    {"host": "robot.example.org"},
    {"zenoh": True, "zenoh_listen": ("tcp/0.0.0.0:7447",)},
    {"zenoh": True, "zenoh_listen": ("tcp/127.0.0.1:7447", "udp/[::]:7447")},
    {"zenoh": True, "zenoh_connect": ("tcp/router:7447",)},
    {"zenoh": True, "zenoh_listen": ("tls/192.0.2.1:7447#iface=eth0",)},
]
PRIVATE: list[dict[str, Any]] = [
    {},
    {"host": "::1"},
    {"host": "localhost"},
    {"zenoh_listen": ("tcp/0.0.0.0:7447",)},  # zenoh is off
    {"zenoh": True, "zenoh_listen": ("tcp/[::1]:7447", "tcp/localhost:0?prio=1")},
    {"zenoh": True, "zenoh_listen": ("unixsock-stream//run/firstfix.sock",)},
]
QUIET = {"scouting": {"multicast": {"enabled": False}}}
RULES = {"enabled": True, "default_permission": "deny", "rules": [], "subjects": [], "policies": []}
RULE = {"id": "a", "permission": "allow", "messages": ["query"], "key_exprs": ["**"]}
TLS = "tls/[::]:7447"
LOGIN = {"auth": {"usrpwd": {"user": "replica", "password": "secret"}}}
KEPT: list[dict[str, Any]] = [  # strangers have no part
    {**QUIET, "listen": {"endpoints": ["tcp/127.0.0.1:7447"]}},
    {**QUIET, "mode": "client"},
    {**QUIET, "listen": {"endpoints": [TLS]}, "access_control": {**RULES, "rules": [RULE]}},
    {**QUIET, "listen": {"endpoints": []}, "connect": {"endpoints": [TLS]}, "transport": LOGIN},
]
OPEN: list[dict[str, Any]] = [
    {},
    {"listen": {"endpoints": ["tcp/127.0.0.1:7447"]}},  # it looks for others
    {**QUIET, "listen": {"endpoints": [TLS]}},
    {**QUIET, "listen": {"endpoints": [TLS]}, "access_control": RULES},
    {**QUIET, "listen": {"endpoints": [TLS]}, "access_control": {**RULES, "enabled": False, "rules": [RULE]}},
    {**QUIET, "listen": {"endpoints": ["tcp/[::]:7447"]}, "access_control": {**RULES, "rules": [RULE]}},
    {**QUIET, "listen": {"endpoints": [TLS, "tcp/[::]:1"]}, "access_control": {**RULES, "rules": [RULE]}},
    {**QUIET, "listen": {"endpoints": [TLS]}, "transport": LOGIN},
    {**QUIET, "listen": {"endpoints": []}, "connect": {"endpoints": ["tcp/a:1"]}, "transport": LOGIN},
    {**QUIET, "listen": {"endpoints": []}, "connect": {"endpoints": [TLS]}},
]


def with_config(folder: Path, content: dict[str, Any], **changes: Any) -> Settings:
    path = folder / "zenoh.json5"
    path.write_text(json.dumps(content))
    return Settings(store="memory://", zenoh_config=path, **changes)


@pytest.mark.parametrize("content", KEPT)
def test_a_closed_zenoh_configuration_is_accepted(tmp_path: Path, content: dict[str, Any]):
    for changes in ({}, {"auth": "on"}, {"auth": "on", "zenoh_trusted": True}, {"auth": "off"}):
        settings = with_config(tmp_path, content, **changes)
        check_security(settings)
        assert open_zenoh(settings) == ""


@pytest.mark.parametrize("content", OPEN)
def test_an_open_zenoh_configuration_is_refused(tmp_path: Path, content: dict[str, Any]):
    for changes in ({}, {"auth": "on", "zenoh_trusted": True}):
        with pytest.raises(
            InvalidOption, match=r"FIRSTFIX_AUTH=on.*FIRSTFIX_ZENOH_CONFIG.*FIRSTFIX_AUTH=off"
        ):
            check_security(with_config(tmp_path, content, **changes))
    for chosen in ("on", "off"):
        check_security(with_config(tmp_path, content, auth=chosen))


def test_trust_in_an_open_zenoh_is_refused():
    with pytest.raises(InvalidOption, match="FIRSTFIX_ZENOH_TRUSTED"):
        check_security(
            Settings(
                store="memory://", auth="on", zenoh=True, zenoh_trusted=True, zenoh_listen=("tcp/[::]:1",)
            )
        )


def test_an_unreadable_zenoh_configuration_is_refused(tmp_path: Path):
    with pytest.raises(InvalidOption, match="zenoh config"):
        check_security(Settings(store="memory://", zenoh_config=tmp_path / "none.json5"))


@pytest.mark.parametrize("changes", PUBLIC)
def test_a_public_service_must_set_authentication(changes: dict[str, Any]):
    with pytest.raises(InvalidOption, match="FIRSTFIX_AUTH"):
        check_security(Settings(store="memory://", **changes))
    for chosen in ("on", "off"):
        check_security(Settings(store="memory://", auth=chosen, **changes))


@pytest.mark.parametrize("changes", PRIVATE)
def test_loopback_needs_no_authentication(changes: dict[str, Any]):
    check_security(Settings(store="memory://", **changes))


@pytest.mark.parametrize(("auth", "level"), [(None, "warning"), ("off", "warning"), ("on", "info")])
def test_the_mode_of_authentication_is_logged(auth: str | None, level: str):
    with capture_logs() as lines:
        check_security(Settings(store="memory://", auth=auth))
    (line,) = lines
    assert line["log_level"] == level
    assert ("authentication is off" in line["event"]) is (auth != "on")


def test_a_trusted_zenoh_is_logged():
    with capture_logs() as lines:
        check_security(Settings(store="memory://", auth="on", zenoh=True, zenoh_trusted=True))
    assert any("zenoh callers need no key" in line["event"] for line in lines)


def test_tokens_without_authentication_are_refused():
    with pytest.raises(InvalidOption, match="JWT"):
        check_security(Settings(store="memory://", jwt_jwks="/keys.json"))


@pytest.mark.parametrize(("host", "loopback"), [("127.0.0.1", True), ("::1", True), ("0.0.0.0", False)])
def test_loopback_addresses_are_known(host: str, loopback: bool):
    assert is_loopback(host) is loopback


def test_the_process_ends_before_it_listens(tmp_path: Path):
    code = """
import sys
from firstfix_service.server import serve
from firstfix_service.settings import Settings
serve(Settings(store=sys.argv[1] + "/store", host="0.0.0.0", port=0))
"""
    command = [sys.executable, "-c", code, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S)
    assert done.returncode != 0
    lines = [json.loads(line)["event"] for line in done.stderr.splitlines()]
    assert any("cannot start: HTTP on 0.0.0.0" in line and "FIRSTFIX_AUTH=on" in line for line in lines)
    assert not (tmp_path / "store").exists()
