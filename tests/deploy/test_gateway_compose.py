"""The gateways' files beside compose.yaml: confined like the others, with options that exist."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path
from typing import Any

import pytest
import typer
import yaml

from firstfix.doors import absent
from firstfix_cli.main import app
from tests.deploy.engine import ROOT, compose

pytestmark = pytest.mark.skipif(bool(absent()), reason="the gateways are left out")
COMPOSE = ROOT / "deploy" / "compose"
BASE = yaml.safe_load((COMPOSE / "compose.yaml").read_text())
ZENOH, DDS = "gateway.yaml", "gateway-dds.yaml"
EACH = pytest.mark.parametrize("file", [ZENOH, DDS])
NEEDED = {
    ZENOH: {"FIRSTFIX_GATEWAY_KEY", "FIRSTFIX_GATEWAY_MAP", "FIRSTFIX_ROBOTS_ROUTER"},
    DDS: {"FIRSTFIX_GATEWAY_KEY", "FIRSTFIX_GATEWAY_MAP"},
}


def text_of(file: str) -> str:
    return (COMPOSE / file).read_text()


def gateway_of(file: str) -> dict[str, Any]:
    (gateway,) = yaml.safe_load(text_of(file))["services"].values()
    return gateway


@EACH
def test_it_may_do_little(file: str):
    gateway = gateway_of(file)
    assert gateway["read_only"] is True
    assert gateway["cap_drop"] == ["ALL"]
    assert gateway["security_opt"] == ["no-new-privileges:true"]
    assert gateway["mem_limit"] == "512m"
    assert gateway["pids_limit"] <= 4096
    assert "ports" not in gateway
    assert "volumes" not in gateway


def test_each_is_where_it_reaches_its_robots():
    assert not {"networks", "network_mode"} & set(gateway_of(ZENOH)), "the default one: the service is there"
    assert gateway_of(DDS)["network_mode"] == "host", "what DDS multicasts stays within a network of compose"


@EACH
def test_its_image_is_that_of_the_replicas(file: str):
    assert gateway_of(file)["image"] == BASE["services"]["replica"]["image"]


@EACH
def test_its_command_is_one_that_exists(file: str):
    command, *options = gateway_of(file)["command"]
    known = typer.main.get_command(app).commands[command]  # type: ignore[attr-defined]
    names = {name for option in known.params for name in option.opts}
    given = [option.partition("=")[0] for option in options]
    assert set(given) <= names
    required = {option.opts[0] for option in known.params if option.required}
    assert required <= set(given)
    assert ("--dds" in given) == (file == DDS)


@EACH
def test_it_needs_a_key_and_holds_none(file: str):
    assert set(re.findall(r"\$\{(\w+):\?", text_of(file))) == NEEDED[file]
    assert gateway_of(file)["environment"]["FIRSTFIX_API_KEY"].startswith("${FIRSTFIX_GATEWAY_KEY:?")


def test_the_one_on_zenoh_asks_a_service_that_each_profile_has():
    gateway = gateway_of(ZENOH)
    for profile, (name, port) in {"minimal": ("firstfix", 8080), "full": ("proxy", 8080)}.items():
        assert profile in gateway["profiles"]
        assert BASE["services"][name]["profiles"] == [profile]
        assert f"http://{name}:{port}" in text_of(ZENOH)
    assert gateway["environment"]["FIRSTFIX_URL"] == "${FIRSTFIX_GATEWAY_URL:-http://firstfix:8080}"


def test_the_one_on_dds_asks_the_port_that_each_profile_publishes():
    gateway = gateway_of(DDS)
    place = gateway["environment"]["FIRSTFIX_URL"].removeprefix("http://")
    for profile, name in {"minimal": "firstfix", "full": "proxy"}.items():
        assert profile in gateway["profiles"]
        assert f"{place}:8080" in BASE["services"][name]["ports"]


@EACH
def test_compose_takes_it_beside_the_services(file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    command = compose()
    environment = tmp_path / "env"
    subprocess.run([COMPOSE / "make-env.sh", environment], check=True, capture_output=True)
    for name in NEEDED[file]:
        monkeypatch.setenv(name, "x")
    command += ["-f", str(COMPOSE / "compose.yaml"), "-f", str(COMPOSE / file)]
    command += ["--env-file", str(environment), "--profile", "minimal", "config", "--services"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (gateway,) = yaml.safe_load(text_of(file))["services"]
    assert {"firstfix", gateway} <= set(done.stdout.split())
