"""A Docker engine for the tests of the images: the one that runs, or one started for them where it can be."""

from __future__ import annotations

import fcntl
import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from firstfix import native
from tests.needs import needs
from tests.waiting import wait_until

ROOT = Path(__file__).parents[2]
LOCK = Path("/tmp/firstfix-images.lock")  # of whoever uses the engine
BASE = "debian:bookworm-slim"
BUILD_S = 2400
NEEDS_DOCKER = needs("Docker with compose", "apt-get install docker.io docker-compose")
# The older builder takes a network for its steps without more rights, and is in every engine.
ENVIRONMENT = {**os.environ, "DOCKER_BUILDKIT": "0"}
REGISTRIES = [name for name in ("PIP_INDEX_URL", "NPM_CONFIG_REGISTRY") if name in os.environ]
BUILD_ARGS = ["--network", "host", *(part for name in REGISTRIES for part in ("--build-arg", name))]
# The containers have this machine's processor, and load this module alone. `make setup` compiled all of them.
BUILD_ARGS += ["--build-arg", f"FIRSTFIX_MODULES={native.variant}"]


def docker(*arguments: str, check: bool = True) -> str:
    """Runs docker; what it printed."""
    done = subprocess.run(["docker", *arguments], capture_output=True, text=True, check=False)
    assert not check or done.returncode == 0, f"docker {' '.join(arguments)}: {done.stderr[-2000:]}"
    return done.stdout.strip()


def compose() -> list[str]:
    """Returns the command of docker compose, of either generation. Skips the test where there is none."""
    if _succeeds("docker", "compose", "version"):
        return ["docker", "compose"]
    if shutil.which("docker-compose") is None:
        pytest.skip(NEEDS_DOCKER)
    return ["docker-compose"]


@contextmanager
def running_engine(log: Path) -> Iterator[None]:
    """One test process has it at a time. Skips the test, and says why, where none can be had."""
    if shutil.which("docker") is None:
        pytest.skip(NEEDS_DOCKER)
    with LOCK.open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if _answers():
            yield
        elif os.geteuid() != 0 or shutil.which("dockerd") is None:
            pytest.skip(needs("a Docker engine", "start one, or run the tests as root, who can"))
        else:
            with _own_engine(log):
                yield


@contextmanager
def _own_engine(log: Path) -> Iterator[None]:
    with log.open("wb") as out:
        engine = subprocess.Popen(["dockerd"], stdout=out, stderr=out)
    try:
        wait_until(lambda: _answers() or engine.poll() is not None)
        if not _answers():
            pytest.skip(
                needs("a Docker engine", f"start one, as dockerd ended here: {log.read_text()[-300:]}")
            )
        yield
        # Of earlier runs; what is younger makes the next build short.
        docker("image", "prune", "--force", "--filter", "until=72h")
    finally:
        engine.terminate()
        engine.wait(60)


def build_images(*targets: str) -> None:
    """Skips the test where there is nothing to build them on."""
    if not _succeeds("docker", "image", "inspect", BASE) and not _succeeds(
        "timeout", "60", "docker", "pull", BASE
    ):
        if os.geteuid() != 0 or shutil.which("debootstrap") is None:
            pytest.skip(needs(BASE, "docker pull, or, as root, apt-get install debootstrap"))
        subprocess.run([ROOT / "deploy/stand-ins/debian.sh"], check=True, timeout=BUILD_S)
    done = subprocess.run(
        [ROOT / "deploy/image/build.sh", *BUILD_ARGS],
        env={**ENVIRONMENT, "TARGETS": " ".join(targets)},
        capture_output=True,
        text=True,
        timeout=BUILD_S,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-1000:] + done.stderr[-3000:]


def _answers() -> bool:
    return _succeeds("docker", "info")


def _succeeds(*command: str) -> bool:
    return subprocess.run(command, capture_output=True, check=False).returncode == 0
