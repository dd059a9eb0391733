"""All modules of the service's image load with the packages that the image has, and no others."""

import json
import re
import runpy
import subprocess
import sys
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from firstfix.doors import absent

pytestmark = pytest.mark.skipif(bool(absent()), reason="the image has the console and the gateways")
ROOT = Path(__file__).resolve().parents[2]
SLIM = runpy.run_path(str(ROOT / "deploy" / "image" / "slim.py"))
LOCK = ROOT / "deploy" / "locks" / "service.txt"
# Refuses these modules as if they were not installed.
REFUSE = """
import json, sys
REFUSED = set(json.loads(sys.stdin.read()))
class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name in REFUSED:
            raise ModuleNotFoundError(f"the service's image has no {name}", name=name)
sys.meta_path.insert(0, Refuse())
"""


def absent_modules() -> list[str]:
    """Installed top-level modules that no package of the service's lock brings, and what slim.py removes."""
    packages_of = packages_distributions()
    present = {canonical(line) for line in LOCK.read_text().splitlines() if "==" in line}
    present |= {"firstfix", "firstfix-console", "firstfix-fleet"}
    absent = [
        module for module, packages in packages_of.items() if present.isdisjoint(map(canonical, packages))
    ]
    return absent + [part.replace("/", ".") for part in SLIM["UNUSED_BY_SERVICE"]]


def canonical(requirement: str) -> str:
    """The package's name as the locks write it."""
    return re.sub("[-_.]+", "-", re.split(r"==|\[", requirement)[0]).lower()


def load_all(refused: list[str]) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", REFUSE + SLIM["LOAD_ALL"], *SLIM["SERVICE_PACKAGES"]]
    return subprocess.run(command, input=json.dumps(refused), capture_output=True, text=True, timeout=600)


def test_every_module_loads_without_what_only_builds_use():
    absent = absent_modules()
    assert {"open3d", "dask", "threadpoolctl", "firstfix_cli.sample_world"} <= set(absent)
    assert "fastapi" not in absent
    loaded = load_all(absent)
    assert loaded.returncode == 0, loaded.stderr[-2000:]


def test_a_missing_package_is_found():
    loaded = load_all(["fastapi"])
    assert loaded.returncode != 0
    assert "the service's image has no fastapi" in loaded.stderr
