"""The backup in docs/how-to/operate.md by its own commands: a store is copied, lost, restored, localizes."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import httpx
import numpy as np
import pytest

from firstfix.access.api_keys import ApiKeys
from firstfix.access.permissions import Grant
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.sources import put_source, source_key
from firstfix.errors import CorruptVersion
from firstfix.maintenance.rebuild import rebuild
from firstfix.store.store import Store
from firstfix.transform import pose_error
from firstfix_client import Client
from tests.servers import free_port, running
from tests.small_world import CONFIG
from tests.waiting import LIMIT_S

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "how-to" / "operate.md").read_text()
MAPS, BACKUP = "s3://maps", "s3://maps-backup"


def commands(heading: str) -> list[str]:
    """The commands of firstfix in a section of the page."""
    section = re.split(r"\n###? ", PAGE.split(f"\n### {heading}\n")[1])[0]
    return re.findall(r"^(firstfix .*?)(?: +#.*)?$", section, re.M)


def run(command: str, places: dict[str, str]) -> str:
    """Runs a documented command with the places of the test, and returns its output."""
    words = [places.get(word, word) for word in shlex.split(command)]
    line = [sys.executable, "-m", "firstfix_cli.main", *words[1:]]
    done = subprocess.run(line, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    assert not done.returncode, done.stderr
    return done.stdout


@pytest.fixture
def store(small_version, small_map: Path, tmp_path: Path) -> Path:
    """A file store with the yard, its source, the record of its build, and a robot's key."""
    folder = tmp_path / "store"
    catalog = Catalog(Store.open(str(folder)))
    key = source_key("hall", put_source(catalog.store, "hall", small_map))
    request = {"map_id": "hall", "source": {"key": key}, "file_name": "yard.ply", "trajectory": None}
    catalog.builds.put("b1", {**request, "config": CONFIG})
    catalog.publish("hall", small_version.directory, small_version.manifest, build_id="b1")
    return folder


def test_a_lost_store_is_restored_and_localizes(store, s3_url, small_scans, tmp_path):
    _, token = ApiKeys(Store.open(str(store))).create("robot-7", Grant.parse(["localize"], ["hall"]))
    (nightly, *_) = commands("Back up")
    places = {MAPS: str(store), BACKUP: s3_url}
    assert run(nightly, places).split()[0] == str(len(list_lasting(store)))
    shutil.rmtree(store)

    elsewhere = tmp_path / "elsewhere"
    places[MAPS] = str(elsewhere)
    copied, listed = (run(command, places) for command in commands("Restore")[:2])
    assert not copied.startswith("0 ")
    assert listed.splitlines()[1].split()[0] == "hall"

    port = free_port()
    settings = {
        "STORE": str(elsewhere),
        "PORT": str(port),
        "AUTH": "on",
        "WORKERS": "1",
        "RUN_BUILDS": "false",
    }
    settings |= {"WORK_DIR": str(tmp_path / "work"), "CACHE_DIR": str(tmp_path / "cache")}
    environment = {f"FIRSTFIX_{name}": value for name, value in settings.items()}
    command = [sys.executable, "-m", "firstfix_cli.main", "serve"]
    with running(command, port, tmp_path / "log", environment):
        with Client(f"http://127.0.0.1:{port}", api_key=token, timeout_s=60) as client:
            answers = [client.localize(scan.points, map_id="hall") for scan, _ in small_scans[6:10]]
        assert httpx.get(f"http://127.0.0.1:{port}/maps").status_code == 401
    errors_m = [
        pose_error(T, answer.T_map_sensor)[0]
        for answer, (_, T) in zip(answers, small_scans[6:10], strict=True)
        if answer.T_map_sensor is not None
    ]
    assert len(errors_m) >= 3
    assert max(errors_m) < 0.05
    assert rebuild(Catalog(Store.open(str(elsewhere))), "hall"), (
        "with the source and the config that were kept"
    )


def list_lasting(store: Path) -> list[str]:
    kept = ("maps/", "builds/", "keys/")
    return [key for key in Store.open(str(store)).list() if key.startswith(kept)]


def test_one_damaged_file_is_put_back(store: Path, tmp_path: Path):
    places = {MAPS: str(store), BACKUP: str(tmp_path / "backup")}
    (nightly, *_) = commands("Back up")
    *_, put_back, _, _ = commands("Restore")
    run(nightly, places)
    catalog = Catalog(Store.open(str(store)))
    version = catalog.active_version("hall")
    assert version is not None
    damaged = store / "maps" / "hall" / "versions" / version / "keys.faiss"
    content = damaged.read_bytes()
    damaged.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    with pytest.raises(CorruptVersion):
        catalog.fetch_version("hall", version, tmp_path / "fetched")
    damaged.unlink()
    run(put_back, places)
    catalog.fetch_version("hall", version, tmp_path / "fetched")
    assert damaged.read_bytes() == content


def test_the_quarterly_drill_succeeds(
    store: Path, small_scans, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    *_, copy, localize = commands("Restore")
    scan = tmp_path / "scan.npy"
    np.save(scan, small_scans[1][0].points)
    places = {BACKUP: str(store), "/tmp/drill": str(tmp_path / "drill"), "scan.pcd": str(scan)}
    run(copy, places)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert "localized" in run(localize, places)


def test_damage_fails_the_nightly_job(store: Path, tmp_path: Path):
    (kept,) = (store / "maps" / "hall" / "sources").iterdir()
    kept.write_bytes(b"x")
    line = [sys.executable, "-m", "firstfix_cli.main", "copy-store", str(store), str(tmp_path / "backup")]
    done = subprocess.run(line, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    assert done.returncode == 2
    assert kept.name in done.stderr
