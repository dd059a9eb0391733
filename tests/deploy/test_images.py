"""The service's image, built and run as it is meant to be."""

from __future__ import annotations

import errno
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import firstfix
from firstfix import native
from firstfix_service.http_api import static_page
from tests.dds_loopback import LOOPBACK
from tests.deploy.engine import BASE, build_images, docker
from tests.waiting import wait_until

IMAGE = "firstfix-service:latest"
NATIVE = Path(native.__file__).parent
MAX_BYTES = 375_000_000  # with the published base image, of 75 MB, less than 450 MB
pytestmark = [pytest.mark.slow, pytest.mark.timeout(3600)]  # the image is built


@pytest.fixture(scope="module")
def image(engine: None) -> str:
    build_images("service")
    return IMAGE


@pytest.fixture(scope="module")
def container(image: str) -> Iterator[str]:
    """A service as the compose file confines it, healthy."""
    name = docker(
        *("run", "--detach", "--init", "--read-only", "--tmpfs", "/tmp", "--cap-drop", "ALL"),
        *("--security-opt", "no-new-privileges:true", "--network", "none"),
        *("-e", "FIRSTFIX_AUTH=off", "-e", "FIRSTFIX_ZENOH=true", "-e", "FIRSTFIX_WORKERS=1", image),
    )

    def is_healthy() -> bool:
        state = inspected(name)["State"]
        assert state["Running"], docker("logs", name)
        return bool(state["Health"]["Status"] == "healthy")

    try:
        wait_until(is_healthy, 1200)
        yield name
    finally:
        docker("rm", "--force", "--volumes", name)


def inspected(thing: str) -> dict:
    return json.loads(docker("inspect", thing))[0]


def python(container: str, code: str) -> str:
    return docker("exec", container, "python", "-c", code)


def fetched(container: str, path: str) -> dict[str, Any]:
    """Returns what the service in a container answers to a GET. Asks from within: it has no network."""
    code = (
        "import json, urllib.error, urllib.parse, urllib.request as u\n"
        f"try: answer = u.urlopen('http://127.0.0.1:8080/{path}')\n"
        "except urllib.error.HTTPError as error: answer = error\n"
        "print(json.dumps({'status': answer.status, 'type': answer.headers['Content-Type'],"
        " 'policy': answer.headers['Content-Security-Policy'],"
        " 'path': urllib.parse.urlsplit(answer.url).path, 'text': answer.read().decode()}))"
    )
    return json.loads(python(container, code))


def test_the_image_is_small(image: str):
    others = [path for path in NATIVE.glob("_*.so") if not path.name.startswith(f"_{native.variant}.")]
    left_out = sum(path.stat().st_size for path in others)  # by FIRSTFIX_MODULES
    assert inspected(image)["Size"] + left_out - inspected(BASE)["Size"] < MAX_BYTES


def test_the_labels_name_version_and_licence(image: str):
    labels = inspected(image)["Config"]["Labels"]
    said = {name.removeprefix("org.opencontainers.image."): value for name, value in labels.items()}
    assert said["title"] == "firstfix-service"
    assert said["version"] == firstfix.__version__
    assert re.fullmatch(r"[0-9a-f]{40}|unknown", said["revision"])
    assert said["created"].startswith("20")
    assert said["licenses"] == "Apache-2.0"


def test_the_container_is_healthy_without_root_on_a_read_only_disk(container: str):
    assert inspected(container)["State"]["Health"]["Status"] == "healthy"
    assert python(container, "import os; print(os.getuid(), os.getgid())") == "10001 10001"
    ready = "import urllib.request as u; print(u.urlopen('http://127.0.0.1:8080/readyz').status)"
    assert python(container, ready) == "200"
    for path in ("/opt/firstfix/x", "/usr/x", "/x"):
        tried = f"try: open('{path}', 'w'); print('written')\nexcept OSError as error: print(error.errno)"
        assert python(container, tried) == str(errno.EROFS)


def test_the_image_has_the_console(container: str):
    """The page is there with all of its files, as a browser asks for them."""
    pytest.importorskip("firstfix_console.page", reason="needs the console: make setup")
    page = fetched(container, "")
    assert (page["status"], page["type"]) == (200, "text/html; charset=utf-8")
    assert page["path"] == "/console/", "the address of the service leads to it"
    assert "default-src 'none'; script-src 'self'; style-src 'self';" in page["policy"]
    assert "unsafe" not in page["policy"]
    named = re.findall(r'(?:src|href)="\./([^"]+)"', page["text"])
    assert {Path(name).suffix for name in named} == {".js", ".css", ".svg"}
    scripts = [name for name in named if name.endswith(".js")]
    # the parts of the page that are loaded when they are opened
    text = "".join(fetched(container, f"console/{script}")["text"] for script in scripts)
    parts = {f"assets/{name}" for name in re.findall(r"\w+-[\w-]{8}\.(?:js|css)", text)}
    assert any(name.startswith("assets/MapView-") for name in parts)
    for name in {*named, *parts}:
        file = fetched(container, f"console/{name}")
        assert (file["status"], file["policy"]) == (200, page["policy"]), name
        assert file["type"].partition(";")[0] == static_page.MEDIA_TYPES[Path(name).suffix], name
        assert file["text"], name
    assert fetched(container, "console/assets/other.js")["status"] == 404


def test_the_image_runs_a_gateway_for_robots_on_dds(container: str):
    """Cyclone DDS loads, and the gateway takes part in a domain, on loopback alone."""
    code = (
        f"import os; os.environ['CYCLONEDDS_URI'] = {LOOPBACK!r}\n"
        "from firstfix_fleet.dds.participant import Participant\n"
        "participant = Participant(0)\n"
        "print(len(participant.entity.guid.bytes))"
    )
    assert python(container, code) == "16"


def test_the_image_has_no_build_tools(container: str):
    found = python(
        container,
        "import importlib.util as i, shutil\n"
        "print([m for m in ('open3d', 'pip', 'matplotlib', 'trimesh') if i.find_spec(m)],"
        " [p for p in ('gcc', 'cc', 'g++', 'ld', 'make', 'pip', 'curl', 'git') if shutil.which(p)])",
    )
    assert found == "[] []"


def test_the_bill_of_materials_has_every_package(container: str):
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
