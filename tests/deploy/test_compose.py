"""deploy/compose, as far as it can be told without an engine: secrets, confinement, the servers' own word."""

from __future__ import annotations

import os
import re
import stat
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import typer
import yaml
import zenoh

from firstfix.access.api_keys import parse_token
from firstfix.doors import absent
from firstfix_cli.main import app
from tests.deploy.engine import ROOT, compose
from tests.servers import program

COMPOSE = ROOT / "deploy" / "compose"
FILE = yaml.safe_load((COMPOSE / "compose.yaml").read_text())
SERVICES = FILE["services"]
OURS = "${FIRSTFIX_REGISTRY:-}firstfix-"


def made_environment(path: Path) -> dict[str, str]:
    subprocess.run([COMPOSE / "make-env.sh", path], check=True, capture_output=True)
    lines = [line for line in path.read_text().splitlines() if line and not line.startswith("#")]
    return dict(line.split("=", 1) for line in lines)


def secrets_of(text: str) -> set[str]:
    """Returns the variables without which compose does not start."""
    return set(re.findall(r"\$\{(\w+):\?", text))


def test_each_machine_gets_secrets_of_its_own(tmp_path: Path):
    first, second = made_environment(tmp_path / "first"), made_environment(tmp_path / "second")
    wanted = secrets_of((COMPOSE / "compose.yaml").read_text())
    assert len(wanted) >= 7
    for name in wanted:
        assert len(first[name]) >= 40
        assert first[name] != second[name]
    assert {name for name in first if first[name] != second[name]} == wanted
    assert len({first[name] for name in wanted}) == len(wanted)
    assert all(parse_token(first[name]) for name in ("FIRSTFIX_ADMIN_KEY", "FIRSTFIX_METRICS_KEY"))
    assert stat.S_IMODE((tmp_path / "first").stat().st_mode) == 0o600


def test_existing_secrets_are_kept(tmp_path: Path):
    (tmp_path / "env").write_text("FIRSTFIX_ADMIN_KEY=mine\n")
    assert made_environment(tmp_path / "env") == {"FIRSTFIX_ADMIN_KEY": "mine"}


def test_the_example_has_no_secret():
    example = (COMPOSE / ".env.example").read_text()
    for name in secrets_of((COMPOSE / "compose.yaml").read_text()):
        assert f"\n{name}=\n" in example


def test_the_only_privileged_container_has_no_network():
    assert [name for name, service in SERVICES.items() if "cap_add" in service] == ["prepare-volumes"]
    assert [name for name, service in SERVICES.items() if service.get("user") == "0:0"] == ["prepare-volumes"]
    assert SERVICES["prepare-volumes"]["network_mode"] == "none"


def test_a_dask_cluster_is_reached_by_builders_alone():
    inside = {name for name, service in SERVICES.items() if "dask" in service.get("networks", [])}
    assert inside == {"s3", "worker", "dask-scheduler", "dask-worker"}
    for name in ("dask-scheduler", "dask-worker"):
        assert SERVICES[name]["networks"] == ["dask"]
        assert "ports" not in SERVICES[name]
        assert SERVICES[name]["profiles"] == ["dask"]
    assert FILE["networks"]["dask"] == {"internal": True}


def test_only_the_gateway_and_its_preparation_get_the_root_keys():
    """The gateway itself, and what makes its users. Whoever reads strangers' maps has a worker's keys."""
    holders: dict[str, set[str]] = {}
    for name, service in SERVICES.items():
        for value in service.get("environment", {}).values():
            for secret in re.findall(r"\$\{(S3_\w+)", str(value)):
                holders.setdefault(secret, set()).add(name)
    assert holders == {
        "S3_ACCESS_KEY": {"s3", "prepare-gateway"},
        "S3_SECRET_KEY": {"s3", "prepare-gateway"},
        "S3_SERVICE_SECRET_KEY": {"prepare-gateway", "prepare-keys", "replica"},
        "S3_WORKER_SECRET_KEY": {"prepare-gateway", "worker", "dask-worker"},
    }
    users = set(
        re.findall(r'^SERVICE, WORKER = "(.+)", "(.+)"$', (COMPOSE / "prepare-gateway.py").read_text(), re.M)[
            0
        ]
    )
    named = {service.get("environment", {}).get("AWS_ACCESS_KEY_ID") for service in SERVICES.values()}
    assert named - {None} == users


def test_a_container_is_in_the_networks_that_it_needs():
    inside = {
        name: {service for service, its in SERVICES.items() if name in its.get("networks", ["default"])}
        for name in FILE["networks"]
    }
    assert inside["store"] == {"s3", "prepare-gateway", "prepare-keys", "replica", "worker"}
    assert inside["queue"] == {"nats", "replica", "worker"}
    assert inside["monitor"] == {"prometheus", "worker"}
    assert inside["sources"] == {"worker"}
    assert not {"worker", "dask-worker", "s3", "nats"} & inside["default"]
    ways_out = {name for name, its in FILE["networks"].items() if not its or its["internal"] is not True}
    assert ways_out == {"default", "sources"}
    assert FILE["networks"]["sources"] == {"internal": "${FIRSTFIX_SOURCES_INTERNAL:-true}"}


def test_a_build_fails_at_its_own_limit_before_its_container_does():
    def default(value: str) -> str:
        return re.sub(r"\$\{\w+:-([^}]+)\}", r"\1", value)

    worker = SERVICES["worker"]
    limit = int(default(worker["environment"]["FIRSTFIX_BUILD_MAX_MEMORY_BYTES"]))
    assert default(worker["mem_limit"]) == "8g"
    assert limit < 8 << 30
    assert SERVICES["firstfix"]["environment"]["FIRSTFIX_BUILD_SANDBOX"] == "${FIRSTFIX_BUILD_SANDBOX:-auto}"


DIGEST = f"sha256:{'5e' * 32}"


def test_images_are_pinned_by_digest(tmp_path: Path):
    """With a docker that knows the digests of third parties' images, and has ours as they were built here."""
    environment = tmp_path / "env"
    made_environment(environment)
    fake = tmp_path / "bin" / "docker"
    fake.parent.mkdir()
    fake.write_text(
        "#!/bin/sh\n"
        'case "$*" in\n'
        "  *RepoDigests*firstfix-*) exit 0 ;;\n"
        f'  *RepoDigests*nats*) echo "nats@{DIGEST}" ;;\n'
        f'  "image inspect"*Id*firstfix-*) echo "sha256:{"1d" * 32}" ;;\n'
        f'  "buildx imagetools"*firstfix-*) exit 1 ;;\n'
        f'  "buildx imagetools"*) echo "{DIGEST}" ;;\n'
        "  *) exit 1 ;;\n"
        "esac\n"
    )
    fake.chmod(0o700)
    path = f"{fake.parent}:{os.environ['PATH']}"
    command = [COMPOSE / "pin.sh", environment]
    for _ in range(2):
        done = subprocess.run(
            command, env={**os.environ, "PATH": path}, capture_output=True, text=True, check=True
        )
    lines = [line for line in environment.read_text().splitlines() if line and not line.startswith("#")]
    pinned = {
        name: value for name, value in (line.split("=", 1) for line in lines) if name.endswith("_DIGEST")
    }
    assert len(lines) == len({line.split("=")[0] for line in lines})
    third = {name for name in pinned if not name.startswith("FIRSTFIX_")}
    assert third == {
        f"{name}_DIGEST" for name in ("VERSITYGW", "NATS", "ZENOH", "HAPROXY", "PROMETHEUS", "GRAFANA")
    }
    assert {pinned[name] for name in third} == {f"@{DIGEST}"}
    assert "firstfix-service:latest was made on this machine" in done.stdout
    assert stat.S_IMODE(environment.stat().st_mode) == 0o600


def test_every_image_takes_a_digest():
    for name, service in SERVICES.items():
        assert re.search(r":\$\{\w+_TAG:-[^}]+\}\$\{\w+_DIGEST:-\}$", service["image"]), name


def test_the_options_of_the_dask_containers_exist():
    for name in ("dask-scheduler", "dask-worker"):
        program, kind, *_ = SERVICES[name]["entrypoint"]
        options = {word.split("=")[0] for word in SERVICES[name]["command"] if word.startswith("--")}
        command = [sys.executable, "-m", program, kind, "--help"]
        said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        assert {option for option in options if option not in said} == set()
    scheduler = SERVICES["dask-worker"]["entrypoint"][-1]
    assert scheduler.replace("tcp://", "dask://") in (COMPOSE / ".env.example").read_text()


@pytest.mark.slow
def test_haproxy_takes_its_file():
    haproxy = program("haproxy", "make all-test-servers installs it, for root")
    done = subprocess.run(
        [haproxy, "-c", "-f", COMPOSE / "haproxy.cfg"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_router_takes_its_file():
    config = zenoh.Config.from_file(str(COMPOSE / "zenoh" / "router.json5"))
    assert config.get_json("mode") == '"router"'
    assert '"deny"' in config.get_json("access_control/default_permission")


def test_stand_in_images_have_the_names_of_the_real_ones():
    named = {re.sub(r"\$\{\w+:-([^}]*)\}", r"\1", service["image"]) for service in SERVICES.values()}
    made = set(re.findall(r"make_image (\S+:\S+) ", (ROOT / "deploy/stand-ins/build.sh").read_text()))
    ours = {name for name in named if name.startswith("firstfix-")}
    assert named - ours - made == {"grafana/grafana:11.3.0"}
    assert made <= named


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


CONFINED = {**SERVICES, **{file: gateway_of(file) for file in (ZENOH, DDS)}}


@pytest.mark.parametrize("name", sorted(CONFINED))
def test_containers_are_confined(name: str):
    service = CONFINED[name]
    assert service["read_only"] is True
    assert service["cap_drop"] == ["ALL"]
    assert service["security_opt"] == ["no-new-privileges:true"]
    assert service["profiles"]
    for port in service.get("ports", []):
        assert port.startswith(("${FIRSTFIX_BIND:-127.0.0.1}:", "127.0.0.1:"))
    assert service["pids_limit"] <= 4096
    if name in SERVICES:
        assert service["mem_limit"]
    else:
        assert service["mem_limit"] == "512m"
        assert not {"ports", "volumes"} & set(service)
    if service["image"].startswith(OURS):
        assert service.get("environment", {}).get("FIRSTFIX_AUTH", "on") == "on"


def test_the_gateways_are_in_the_networks_of_their_robots():
    assert not {"networks", "network_mode"} & set(gateway_of(ZENOH)), "the default one: the service is there"
    assert gateway_of(DDS)["network_mode"] == "host", "what DDS multicasts stays within a network of compose"


@EACH
def test_the_image_of_a_gateway_is_that_of_the_replicas(file: str):
    assert gateway_of(file)["image"] == FILE["services"]["replica"]["image"]


@pytest.mark.skipif(bool(absent()), reason="the gateways are left out")
@EACH
def test_the_command_of_a_gateway_exists(file: str):
    command, *options = gateway_of(file)["command"]
    known = typer.main.get_command(app).commands[command]  # type: ignore[attr-defined]
    names = {name for option in known.params for name in option.opts}
    given = [option.partition("=")[0] for option in options]
    assert set(given) <= names
    required = {option.opts[0] for option in known.params if option.required}
    assert required <= set(given)
    assert ("--dds" in given) == (file == DDS)


@EACH
def test_a_gateway_needs_a_key_and_holds_none(file: str):
    assert set(re.findall(r"\$\{(\w+):\?", text_of(file))) == NEEDED[file]
    assert gateway_of(file)["environment"]["FIRSTFIX_API_KEY"].startswith("${FIRSTFIX_GATEWAY_KEY:?")


def test_the_zenoh_gateway_asks_a_service_of_each_profile():
    gateway = gateway_of(ZENOH)
    for profile, (name, port) in {"minimal": ("firstfix", 8080), "full": ("proxy", 8080)}.items():
        assert profile in gateway["profiles"]
        assert FILE["services"][name]["profiles"] == [profile]
        assert f"http://{name}:{port}" in text_of(ZENOH)
    assert gateway["environment"]["FIRSTFIX_URL"] == "${FIRSTFIX_GATEWAY_URL:-http://firstfix:8080}"


def test_the_dds_gateway_asks_a_published_port():
    gateway = gateway_of(DDS)
    place = gateway["environment"]["FIRSTFIX_URL"].removeprefix("http://")
    for profile, name in {"minimal": "firstfix", "full": "proxy"}.items():
        assert profile in gateway["profiles"]
        assert f"{place}:8080" in FILE["services"][name]["ports"]


@EACH
def test_compose_accepts_the_gateway_beside_the_services(
    file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
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
