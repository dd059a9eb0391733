"""Fixtures: what stands in for Azure and Google on this machine."""

from __future__ import annotations

import base64
import hashlib
import hmac
import json
import secrets
import uuid
from collections.abc import Iterator
from email.utils import formatdate

import httpx
import pytest

from tests.servers import free_port, program, running

CONTAINER = "firstfix-tests"
_ACCOUNT = "tests"


@pytest.fixture(scope="session")
def azurite(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Azurite with an empty container; the account's key stands in the environment."""
    name = program("azurite-blob", "make all-test-servers installs it, with npm")
    port, key = free_port(), base64.b64encode(secrets.token_bytes(32)).decode()
    command = [name, "--blobHost", "127.0.0.1", "--blobPort", str(port), "--silent", "--disableTelemetry"]
    command += ["--skipApiVersionCheck", "--inMemoryPersistence"]
    log = tmp_path_factory.mktemp("azurite") / "log"
    with (
        pytest.MonkeyPatch.context() as patch,
        running(command, port, log, {"AZURITE_ACCOUNTS": f"{_ACCOUNT}:{key}"}),
    ):
        patch.setenv("AZURE_STORAGE_ACCOUNT_KEY", key)
        _make_container(f"http://127.0.0.1:{port}", base64.b64decode(key))
        yield f"http://127.0.0.1:{port}/{_ACCOUNT}"


@pytest.fixture
def azure_url(azurite: str) -> str:
    """The URL of an empty store on Azurite."""
    return f"az://{CONTAINER}/{uuid.uuid4().hex}?account_name={_ACCOUNT}&endpoint={azurite}&allow_http=true"


def _make_container(server: str, key: bytes) -> None:
    """Makes a container by a signed request: obstore cannot."""
    headers = {"x-ms-date": formatdate(usegmt=True), "x-ms-version": "2021-08-06"}
    lines = ["PUT", *[""] * 11, *(f"{name}:{value}" for name, value in headers.items())]
    to_sign = "\n".join([*lines, f"/{_ACCOUNT}/{_ACCOUNT}/{CONTAINER}", "restype:container"])
    signature = base64.b64encode(hmac.new(key, to_sign.encode(), hashlib.sha256).digest()).decode()
    headers["Authorization"] = f"SharedKey {_ACCOUNT}:{signature}"
    url = f"{server}/{_ACCOUNT}/{CONTAINER}?restype=container"
    httpx.put(url, headers=headers).raise_for_status()


@pytest.fixture(scope="session")
def fake_gcs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A fake-gcs-server with an empty bucket.

    It lists and reads like Google's XML API, but writes only by the JSON API, which obstore does not speak.
    """
    name = program("fake-gcs-server", "go install github.com/fsouza/fake-gcs-server@latest")
    port = free_port()
    folder = tmp_path_factory.mktemp("gcs")
    (folder / "data" / CONTAINER).mkdir(parents=True)
    host = f"127.0.0.1:{port}"
    command = [name, "-scheme", "http", "-host", "127.0.0.1", "-port", str(port), "-backend", "memory"]
    command += ["-data", str(folder / "data"), "-external-url", f"http://{host}", "-public-host", host]
    account = {"disable_oauth": True, "client_email": "", "private_key": "", "private_key_id": ""}
    with pytest.MonkeyPatch.context() as patch, running(command, port, folder / "log"):
        patch.setenv("GOOGLE_SERVICE_ACCOUNT_KEY", json.dumps({**account, "gcs_base_url": f"http://{host}"}))
        yield f"http://{host}"
