"""The service's image, built and run as it is meant to be."""

from __future__ import annotations

import errno
import json
import re
from collections.abc import Iterator

import pytest
from engine import BASE, build_images, docker

import firstfix
from waiting import wait_until

IMAGE = "firstfix-service:latest"
MAX_BYTES = 375_000_000  # with the published base image, of 75 MB, less than 450 MB
pytestmark = [pytest.mark.slow, pytest.mark.timeout(1500)]


@pytest.fixture(scope="module")
def image(engine: None) -> str:
    build_images("service")
    return IMAGE


@pytest.fixture(scope="module")
def container(image: str) -> Iterator[str]:
    """A service as the compose file confines it."""
    name = docker(
        *("run", "--detach", "--init", "--read-only", "--tmpfs", "/tmp", "--cap-drop", "ALL"),
        *("--security-opt", "no-new-privileges:true", "--network", "none"),
        *("-e", "FIRSTFIX_AUTH=off", "-e", "FIRSTFIX_ZENOH=true", "-e", "FIRSTFIX_WORKERS=1", image),
    )
    yield name
    docker("rm", "--force", "--volumes", name)


def inspected(thing: str) -> dict:
    return json.loads(docker("inspect", thing))[0]


def python(container: str, code: str) -> str:
    return docker("exec", container, "python", "-c", code)


def test_it_is_small(image: str):
    assert inspected(image)["Size"] - inspected(BASE)["Size"] < MAX_BYTES


def test_its_labels_say_what_it_is(image: str):
    labels = inspected(image)["Config"]["Labels"]
    said = {name.removeprefix("org.opencontainers.image."): value for name, value in labels.items()}
    assert said["title"] == "firstfix-service"
    assert said["version"] == firstfix.__version__
    assert re.fullmatch(r"[0-9a-f]{40}|unknown", said["revision"])
    assert said["created"].startswith("20")
    assert said["licenses"] == "Apache-2.0"


def test_it_becomes_healthy_without_root_and_with_a_read_only_root(container: str):
    def is_healthy() -> bool:
        state = inspected(container)["State"]
        assert state["Running"], docker("logs", container)
        return bool(state["Health"]["Status"] == "healthy")

    wait_until(is_healthy, 1200)
    assert python(container, "import os; print(os.getuid(), os.getgid())") == "10001 10001"
    ready = "import urllib.request as u; print(u.urlopen('http://127.0.0.1:8080/readyz').status)"
    assert python(container, ready) == "200"
    for path in ("/opt/firstfix/x", "/usr/x", "/x"):
        tried = f"try: open('{path}', 'w'); print('written')\nexcept OSError as error: print(error.errno)"
        assert python(container, tried) == str(errno.EROFS)


def test_the_console_is_in_it(container: str):
    address = "http://127.0.0.1:8080/console/"
    page = python(container, f"import urllib.request as u; print(u.urlopen('{address}').read())")
    assert "assets/index-" in page


def test_there_is_nothing_in_it_to_build_with(container: str):
    found = python(
        container,
        "import importlib.util as i, shutil\n"
        "print([m for m in ('open3d', 'pip', 'matplotlib', 'trimesh') if i.find_spec(m)],"
        " [p for p in ('gcc', 'cc', 'g++', 'ld', 'make', 'pip', 'curl', 'git') if shutil.which(p)])",
    )
    assert found == "[] []"


def test_its_bill_of_materials_has_every_package(container: str):
    bill = json.loads(docker("exec", container, "cat", "/usr/share/sbom/firstfix.cdx.json"))
    assert (bill["bomFormat"], bill["specVersion"]) == ("CycloneDX", "1.5")
    assert bill["metadata"]["component"]["version"] == firstfix.__version__
    purls = {component["purl"] for component in bill["components"]}
    assert len(purls) == len(bill["components"])
    listed = "import importlib.metadata as m; print(*(f'{d.name}=={d.version}' for d in m.distributions()))"
    for line in python(container, listed).split():
        name, version = line.split("==")
        assert f"pkg:pypi/{name.lower().replace('_', '-')}@{version}" in purls
    installed = docker("exec", container, "dpkg-query", "-W", "-f", "${Package}\n").split()
    debian = {
        component["name"] for component in bill["components"] if component["purl"].startswith("pkg:deb/")
    }
    assert debian == set(installed)
    assert all(component["version"] for component in bill["components"])
