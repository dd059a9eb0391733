"""deploy/compose/prepare-gateway.py on a real gateway: what services and workers may do there."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from firstfix.access.api_keys import ApiKeys
from firstfix.access.permissions import Grant
from firstfix.builds.callers import CallerUsage
from firstfix.builds.options import BuildOptions
from firstfix.builds.shared_stages import SharedStages
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import Manifest
from firstfix.catalog.sources import put_source
from firstfix.errors import StoreError
from firstfix.store.store import Store
from firstfix_builder.job.build_job import BuildJob, BuildResult
from firstfix_builder.job.run_build import run_build
from tests.deploy.engine import ROOT
from tests.servers import free_port, running_versitygw

SCRIPT = ROOT / "deploy" / "compose" / "prepare-gateway.py"
SECRETS = {"SERVICE_SECRET_KEY": "s-service-secret", "WORKER_SECRET_KEY": "s-worker-secret"}


class Gateway:
    def __init__(self, url: str, root: dict[str, str]) -> None:
        self.url = url
        self._root = root

    def prepare(self, **secrets: str) -> None:
        environment = {**os.environ, **self._root, **SECRETS, **secrets, "S3_ENDPOINT": self.url}
        subprocess.run([sys.executable, SCRIPT], env=environment, check=True, timeout=240)

    def as_user(self, name: str, monkeypatch: pytest.MonkeyPatch, secret: str = "") -> Store:
        monkeypatch.setenv("AWS_ACCESS_KEY_ID", f"firstfix-{name}")
        monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", secret or SECRETS[f"{name.upper()}_SECRET_KEY"])
        return Store.open(self.store_url)

    @property
    def store_url(self) -> str:
        return f"s3://firstfix?endpoint={self.url}&region=us-east-1&allow_http=true"


@pytest.fixture(scope="module")
def gateway(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Gateway]:
    folder, port = tmp_path_factory.mktemp("gateway"), free_port()
    (folder / "data" / "firstfix").mkdir(parents=True)
    (folder / "iam").mkdir()
    options = ("--iam-dir", str(folder / "iam"), "--iam-cache-disable")
    with running_versitygw(folder, port, "root-key", "root-secret", *options):
        root = {"ROOT_ACCESS_KEY": "root-key", "ROOT_SECRET_KEY": "root-secret"}
        made = Gateway(f"http://127.0.0.1:{port}", root)
        made.prepare()
        made.prepare()  # as at every start
        yield made


def test_a_service_may_write_every_folder(gateway: Gateway, monkeypatch: pytest.MonkeyPatch):
    store = gateway.as_user("service", monkeypatch)
    store.probe()
    _, token = ApiKeys(store).create("robot", Grant.parse(["admin"], ["*"]))
    assert token
    for folder in ("maps", "builds", "uploads", "recorded-queries", "idempotency"):
        assert store.put_new(f"{folder}/x", b"x")
        assert store.get(f"{folder}/x") == b"x"
        assert f"{folder}/x" in store.list(folder)
        store.delete(f"{folder}/x")


def test_a_worker_may_build(gateway: Gateway, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    service = Catalog(gateway.as_user("service", monkeypatch))
    (tmp_path / "upload").write_bytes(np.random.default_rng(0).bytes(20 << 20))  # in several parts
    key = f"maps/hall/sources/{put_source(service.store, 'hall', tmp_path / 'upload')}"
    request = {"map_id": "hall", "source": {"key": key}, "file_name": "hall.ply", "config": {}}
    service.builds.put("b1", request)
    gateway.as_user("worker", monkeypatch)

    def build_version(job: BuildJob) -> BuildResult:
        directory = tmp_path / "version"
        directory.mkdir()
        (directory / "index.bin").write_bytes(job.source.read_bytes())
        stages = SharedStages(Store.open(gateway.store_url))
        assert stages.put("a" * 64, "one", directory) > 0
        return BuildResult(directory, Manifest.for_directory(directory))

    options = BuildOptions(store=gateway.store_url, build_id="b1", work=tmp_path / "work")
    assert run_build(options, build_version, ("one",)) == 0
    assert service.active_version("hall") == service.builds.status("b1")["version"]
    usage = CallerUsage(Catalog(gateway.as_user("worker", monkeypatch)).builds)
    usage.charge("robot-7", "b1", 1, 60.0)  # as the worker does when an attempt has ended
    assert usage.minutes_today("robot-7") == 1.0


def test_each_folder_of_the_store_is_allowed_or_denied_to_workers():
    """A new folder is denied to workers until it is in a list: builds would fail in compose alone."""
    not_workers = {"keys", "recorded-queries", "idempotency", "pending_deletions", "checked"}
    text = "".join(path.read_text() for path in (ROOT / "core" / "firstfix").rglob("*.py"))
    folders = set(re.findall(r'^_?(?:\w+_)?(?:FOLDER|ROOT) = "(\w+)"', text, re.M))
    assert len(folders) >= 6
    workers = re.findall(r"^WORKERS_FOLDERS = \((.+)\)", SCRIPT.read_text(), re.M)[0]
    assert folders <= not_workers | set(re.findall(r"\w+", workers))


@pytest.mark.parametrize("key", ["keys/x", "recorded-queries/x", "uploads/x/upload.json", "idempotency/x"])
def test_a_worker_is_denied_other_folders(gateway: Gateway, monkeypatch: pytest.MonkeyPatch, key: str):
    gateway.as_user("service", monkeypatch).put(key, b"secret")
    worker = gateway.as_user("worker", monkeypatch)
    with pytest.raises(StoreError, match="refuses"):
        worker.get(key)
    with pytest.raises(StoreError, match="refuses"):
        worker.put(key, b"mine")
    with pytest.raises(StoreError, match="Access Denied"):
        worker.delete(key)
    with pytest.raises(StoreError, match="refuses"):
        ApiKeys(worker).create("mine", Grant.parse(["admin"], ["*"]))


def test_services_and_workers_cannot_administer_the_gateway(gateway: Gateway):
    for name in ("service", "worker"):
        keys = {
            "ROOT_ACCESS_KEY": f"firstfix-{name}",
            "ROOT_SECRET_KEY": SECRETS[f"{name.upper()}_SECRET_KEY"],
        }
        environment = {**os.environ, **keys, **SECRETS, "S3_ENDPOINT": gateway.url}
        done = subprocess.run([sys.executable, SCRIPT], env=environment, capture_output=True, check=False)
        assert b"HTTP Error 403" in done.stderr


def test_a_new_secret_takes_the_place_of_the_old_one(gateway: Gateway, monkeypatch: pytest.MonkeyPatch):
    gateway.prepare(WORKER_SECRET_KEY="another-secret")
    gateway.as_user("worker", monkeypatch, "another-secret").probe()
    with pytest.raises(StoreError):
        gateway.as_user("worker", monkeypatch).probe()
    gateway.prepare()
