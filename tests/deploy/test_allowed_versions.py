"""The lowest and the newest versions that pyproject.toml allows: install, build a map, serve, localize."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import httpx
import numpy as np
import pytest
import tomllib
from numpy.typing import NDArray

from tests.claimed import free_port
from tests.needs import needs
from tests.small_world import CONFIG, SENSOR, SmallWorld
from tests.waiting import wait_until

pytestmark = pytest.mark.slow

REPO = Path(__file__).resolve().parents[2]
PACKAGES = ("plugins/console", "plugins/fleet")
EXTRAS = ("builder", "dds", "vda5050")  # the others add to them what tests of their own look at
OF_LOWEST = ("3.11", "3.12")  # newer ones have no wheels of the lowest NumPy, SciPy and others
OTHERS = {"3.11", "3.12", "3.13"} - {"{}.{}".format(*sys.version_info)}


def runs(python: str) -> bool:
    """False for the shims that tools of many versions put on the PATH for those that are not chosen, too."""
    return (
        shutil.which(python) is not None
        and not subprocess.run([python, "-V"], capture_output=True).returncode
    )


PYTHONS = [sys.executable, *filter(runs, (f"python{version}" for version in sorted(OTHERS)))]
# Modules that only a ROS 2 has what they import for, and compiled ones of other processors.
NOT_IMPORTED = ("firstfix_ros.node", "firstfix_ros.on_rclpy", "firstfix_ros.on_rclpy.fleet")
IMPORT_ALL = f"""
import importlib, pkgutil
def names(package):
    for found in pkgutil.iter_modules(importlib.import_module(package).__path__, package + "."):
        if found.name.startswith({NOT_IMPORTED!r}) or found.name.rpartition(".")[2].startswith("_"):
            continue
        yield found.name
        if found.ispkg:
            yield from names(found.name)
parts = ("", "_builder", "_cli", "_client", "_console", "_fleet", "_ros", "_service")
packages = ["firstfix" + part for part in parts]
imported = [importlib.import_module(name) for package in packages for name in names(package)]
print(len(imported))
"""


@dataclass(frozen=True)
class Installed:
    """A clean environment with firstfix, and what its programs are started with."""

    python: Path
    variables: dict[str, str]

    def run(self, *arguments: str | Path) -> str:
        done = subprocess.run(
            [self.python, *arguments], env=self.variables, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
        return done.stdout

    def firstfix(self, *arguments: str | Path) -> str:
        return self.run(self.python.with_name("firstfix"), *arguments)


def uv(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Runs uv with the machine's index and certificates, as scripts/setup.sh does."""
    program = shutil.which("uv", path=os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]))
    if program is None:
        pytest.skip(needs("uv", "make setup"))
    variables = {"UV_SYSTEM_CERTS": "1", "UV_HTTP_TIMEOUT": "120", **os.environ}
    pip = [sys.executable, "-m", "pip", "config", "get", "global.index-url"]
    index = os.environ.get("PIP_INDEX_URL") or subprocess.run(pip, capture_output=True, text=True).stdout
    if index.strip():
        variables.setdefault("UV_DEFAULT_INDEX", index.strip())
    return subprocess.run(
        [program, *arguments], env=variables, cwd=REPO, capture_output=True, text=True, check=False
    )


def must(done: subprocess.CompletedProcess[str]) -> None:
    assert done.returncode == 0, done.stderr[-4000:]


def compile_versions(versions: Path, python: str, resolution: str, *extras: str) -> None:
    wanted = [word for extra in extras for word in ("--extra", extra)]
    projects = ("pyproject.toml", *(f"{package}/pyproject.toml" for package in PACKAGES))
    command = ("pip", "compile", *projects, "--resolution", resolution, "--no-emit-index-url")
    command += ("--no-emit-package", "firstfix")
    must(uv(*command, *wanted, "--python-version", version_of(python), "-o", versions))


def version_of(python: str) -> str:
    say = "import sys; print('%d.%d' % sys.version_info[:2])"
    return subprocess.run([python, "-c", say], capture_output=True, text=True, check=True).stdout.strip()


@pytest.fixture(scope="module", params=PYTHONS, ids=lambda python: Path(python).name)
def interpreter(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(scope="module")
def wheel(interpreter: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, with one compiled module, made by the lowest versions of its build tools."""
    folder = tmp_path_factory.mktemp("wheel")
    wanted = tomllib.loads((REPO / "pyproject.toml").read_text())["build-system"]["requires"]
    lowest = folder / "lowest.txt"
    lowest.write_text("".join(f"{requirement.replace('>=', '==')}\n" for requirement in wanted))
    one_module = ("-C", "cmake.define.FIRSTFIX_MODULES=baseline", "-C", f"build-dir={folder / 'build'}")
    constraints = ("--build-constraints", lowest)
    must(uv("build", "--wheel", "--python", interpreter, *constraints, *one_module, "-o", folder))
    (built,) = folder.glob("*.whl")
    return built


@pytest.fixture(scope="module", params=("lowest-direct", "highest"))
def allowed_versions(request, interpreter, wheel, tmp_path_factory) -> Iterator[Installed]:
    """An environment with the lowest or the newest versions. Its files are hard links into uv's cache."""
    if request.param == "lowest-direct" and version_of(interpreter) not in OF_LOWEST:
        pytest.skip(needs(f"one of Python {', '.join(OF_LOWEST)}", "newer ones have no wheels of the lowest"))
    folder = tmp_path_factory.mktemp(request.param)
    environment, versions = folder / "environment", folder / "versions.txt"
    python = environment / "bin" / "python"
    compile_versions(versions, interpreter, request.param, *EXTRAS)
    must(uv("venv", "--python", interpreter, environment))
    must(uv("pip", "install", "--python", python, "-r", versions))
    must(
        uv(
            "pip",
            "install",
            "--python",
            python,
            "--no-deps",
            wheel,
            *(REPO / package for package in PACKAGES),
        )
    )
    must(uv("pip", "check", "--python", python))
    own = {name: str(folder / name) for name in ("XDG_CACHE_HOME", "XDG_STATE_HOME")}
    inherited = {
        name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL"))
    }
    yield Installed(python, {**inherited, **own})
    shutil.rmtree(environment)


@contextmanager
def serving(installed: Installed, folder: Path) -> Iterator[tuple[str, str, Path]]:
    """A service of the environment: its URL, its zenoh endpoint, and its log."""
    port, zenoh, log = free_port(), f"tcp/127.0.0.1:{free_port()}", folder / "log"
    url = f"http://127.0.0.1:{port}"
    command = [installed.python.with_name("firstfix"), "serve", "--store", folder / "store"]
    command += ["--port", str(port), "--zenoh-listen", zenoh, "--work", folder / "work"]
    with log.open("w") as output:
        service = subprocess.Popen(command, env=installed.variables, stdout=output, stderr=output)
    try:
        wait_until(lambda: service.poll() is not None or is_ready(url), what=f"the service, {log}")
        assert service.poll() is None, log.read_text()[-3000:]
        yield url, zenoh, log
    finally:
        service.terminate()
        service.wait()


def is_ready(url: str) -> bool:
    try:
        return httpx.get(f"{url}/readyz", timeout=5.0).is_success
    except httpx.TransportError:
        return False


def scan_of(world: SmallWorld) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Points of a scan that no template has, and T_map_sensor."""
    from firstfix.builds.config import PerturbConfig
    from firstfix.sensor import SensorModel
    from firstfix_builder.simulation.perturb import perturbed_scans
    from firstfix_builder.simulation.simulate import Simulator

    simulator, sensor = Simulator(world.vertices, world.triangles), SensorModel.from_mapping(SENSOR)
    some, rng = PerturbConfig(occluders=3, unmapped=0, vanished=0), np.random.default_rng(11)
    ((scan, T_map_sensor),) = perturbed_scans(
        simulator, sensor, np.array([[1.0, -1.0, 0.8]]), 1.0, 1, some, rng
    )
    return scan.points, T_map_sensor


def test_every_module_can_be_imported(allowed_versions: Installed):
    assert int(allowed_versions.run("-c", IMPORT_ALL)) > 500


def test_allowed_versions_build_serve_and_localize(
    allowed_versions: Installed, small_world: SmallWorld, tmp_path: Path
):
    points, T_map_sensor = scan_of(small_world)
    np.save(tmp_path / "scan.npy", points)
    (tmp_path / "config.json").write_text(json.dumps(CONFIG))
    yard = small_world.write(tmp_path / "yard.ply")
    with serving(allowed_versions, tmp_path) as (url, zenoh, log):
        config = ("--config", tmp_path / "config.json")
        allowed_versions.firstfix("build", yard, "--map-id", "yard", *config, "--url", url)
        for transport in (("--url", url), ("--zenoh", zenoh)):
            said = allowed_versions.firstfix(
                "localize", tmp_path / "scan.npy", "--map", "yard", "--json", *transport
            )
            answer = json.loads(said)
            position_m = answer["T_map_sensor"]["position"]
            assert np.linalg.norm(np.subtract(position_m, T_map_sensor[:3, 3])) < 0.05
        assert httpx.get(f"{url}/openapi.json").is_success
        told = log.read_text()
    assert not re.findall(r'"level": "(?:error|critical)"|^Traceback', told, re.M), told[-3000:]


def test_python_3_10_gets_every_part_but_the_service(tmp_path: Path):
    def compiled(*extras: str, project: str = "pyproject.toml") -> subprocess.CompletedProcess[str]:
        wanted = [word for extra in extras for word in ("--extra", extra)]
        return uv("pip", "compile", project, "--python-version", "3.10", *wanted, "-o", tmp_path / "o")

    for light in ((), ("zenoh",), ("gateway",)):
        must(compiled(*light))
    for light in ((), ("dds",), ("vda5050",)):
        must(compiled(*light, project="plugins/fleet/pyproject.toml"))
    refused = compiled("service")
    assert refused.returncode != 0
    assert "Python>=3.11" in refused.stderr
