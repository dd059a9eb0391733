"""deploy/compose, as far as it can be told without an engine: secrets, confinement, the servers' own word."""

from __future__ import annotations

import os
import re
import stat
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
import zenoh

from firstfix.access.api_keys import parse_token
from tests.deploy.engine import ROOT
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


def test_secrets_that_are_there_stay(tmp_path: Path):
    (tmp_path / "env").write_text("FIRSTFIX_ADMIN_KEY=mine\n")
    assert made_environment(tmp_path / "env") == {"FIRSTFIX_ADMIN_KEY": "mine"}


def test_no_secret_is_checked_in():
    example = (COMPOSE / ".env.example").read_text()
    for name in secrets_of((COMPOSE / "compose.yaml").read_text()):
        assert f"\n{name}=\n" in example


@pytest.mark.parametrize("name", sorted(SERVICES))
def test_a_container_may_do_little(name: str):
    service = SERVICES[name]
    assert service["read_only"] is True
    assert service["cap_drop"] == ["ALL"]
    assert service["security_opt"] == ["no-new-privileges:true"]
    assert service["profiles"]
    for port in service.get("ports", []):
        assert port.startswith(("${FIRSTFIX_BIND:-127.0.0.1}:", "127.0.0.1:"))
    assert service["mem_limit"]
    assert service["pids_limit"] <= 4096
    if service["image"].startswith(OURS):
        environment = service.get("environment", {})
        assert environment.get("FIRSTFIX_AUTH", "on") == "on"


def test_the_only_one_with_rights_has_no_network():
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


def test_the_gateways_root_keys_are_with_those_who_need_them():
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


def test_what_the_dask_containers_are_started_with_is_what_dask_takes():
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


def test_what_cannot_be_pulled_is_made_under_the_same_name():
    named = {re.sub(r"\$\{\w+:-([^}]*)\}", r"\1", service["image"]) for service in SERVICES.values()}
    made = set(re.findall(r"make_image (\S+:\S+) ", (ROOT / "deploy/stand-ins/build.sh").read_text()))
    ours = {name for name in named if name.startswith("firstfix-")}
    assert named - ours - made == {"grafana/grafana:11.3.0"}
    assert made <= named
