"""deploy/compose/gateway.yaml beside compose.yaml: confined like the others, with options that exist."""

from __future__ import annotations

import re
import shutil
import subprocess

import pytest
import typer
import yaml
from engine import ROOT

from firstfix_cli.main import app

COMPOSE = ROOT / "deploy" / "compose"
TEXT = (COMPOSE / "gateway.yaml").read_text()
BASE = yaml.safe_load((COMPOSE / "compose.yaml").read_text())
(GATEWAY,) = yaml.safe_load(TEXT)["services"].values()


def test_it_may_do_little():
    assert GATEWAY["read_only"] is True
    assert GATEWAY["cap_drop"] == ["ALL"]
    assert GATEWAY["security_opt"] == ["no-new-privileges:true"]
    assert GATEWAY["mem_limit"] == "512m"
    assert GATEWAY["pids_limit"] <= 4096
    assert "ports" not in GATEWAY
    assert "volumes" not in GATEWAY
    assert "networks" not in GATEWAY, "the default one: there are the service and the way to the robots"


def test_its_image_is_that_of_the_replicas():
    assert GATEWAY["image"] == BASE["services"]["replica"]["image"]


def test_its_command_is_one_that_exists():
    command, *options = GATEWAY["command"]
    known = typer.main.get_command(app).commands[command]  # type: ignore[attr-defined]
    names = {name for option in known.params for name in option.opts}
    given = [option.partition("=")[0] for option in options]
    assert set(given) <= names
    required = {option.opts[0] for option in known.params if option.required}
    assert required <= set(given)


def test_it_needs_a_key_and_holds_none():
    assert set(re.findall(r"\$\{(\w+):\?", TEXT)) == {
        "FIRSTFIX_GATEWAY_KEY",
        "FIRSTFIX_GATEWAY_MAP",
        "FIRSTFIX_ROBOTS_ROUTER",
    }
    assert GATEWAY["environment"]["FIRSTFIX_API_KEY"].startswith("${FIRSTFIX_GATEWAY_KEY:?")


def test_it_asks_a_service_that_each_profile_has():
    url = GATEWAY["environment"]["FIRSTFIX_URL"]
    for profile, (name, port) in {"minimal": ("firstfix", 8080), "full": ("proxy", 8080)}.items():
        assert profile in GATEWAY["profiles"]
        assert BASE["services"][name]["profiles"] == [profile]
        assert f"http://{name}:{port}" in TEXT
    assert url == "${FIRSTFIX_GATEWAY_URL:-http://firstfix:8080}"


def test_compose_takes_both_files(tmp_path, monkeypatch: pytest.MonkeyPatch):
    if shutil.which("docker") is None:
        pytest.skip("no docker here")
    if subprocess.run(["docker", "compose", "version"], capture_output=True, check=False).returncode:
        pytest.skip("docker has no compose here")
    environment = tmp_path / "env"
    subprocess.run([COMPOSE / "make-env.sh", environment], check=True, capture_output=True)
    for name in ("KEY", "MAP"):
        monkeypatch.setenv(f"FIRSTFIX_GATEWAY_{name}", "x")
    monkeypatch.setenv("FIRSTFIX_ROBOTS_ROUTER", "tcp/192.168.0.5:7447")
    files = ["-f", COMPOSE / "compose.yaml", "-f", COMPOSE / "gateway.yaml"]
    command = [
        "docker",
        "compose",
        "--env-file",
        environment,
        "--profile",
        "minimal",
        *files,
        "config",
        "--services",
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert {"firstfix", "ros-gateway"} <= set(done.stdout.split())
