"""Fixtures that several packages share: real object stores."""

from __future__ import annotations

import os
import secrets
import shutil
import socket
import subprocess
import time
import uuid
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest_plugins = ["small_world"]

BUCKET = "firstfix-tests"


def _versitygw() -> str | None:
    go_bin = os.environ.get("GOBIN") or str(Path(os.environ.get("GOPATH") or Path.home() / "go") / "bin")
    return shutil.which("versitygw") or shutil.which("versitygw", path=go_bin)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.fixture(scope="session")
def s3_gateway(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A real S3 server on this machine, with an empty bucket; its credentials stand in the environment."""
    program = _versitygw()
    if program is None:
        pytest.skip("no versitygw: go install github.com/versity/versitygw/cmd/versitygw@latest")
    folder = tmp_path_factory.mktemp("s3")
    (folder / "data" / BUCKET).mkdir(parents=True)
    port, access, secret = _free_port(), secrets.token_hex(8), secrets.token_hex(16)
    with pytest.MonkeyPatch.context() as patch, (folder / "log").open("wb") as log:
        patch.setenv("AWS_ACCESS_KEY_ID", access)
        patch.setenv("AWS_SECRET_ACCESS_KEY", secret)
        for name in ("AWS_SESSION_TOKEN", "AWS_PROFILE", "AWS_ENDPOINT_URL"):
            patch.delenv(name, raising=False)
        server = subprocess.Popen(
            [program, "--port", f"127.0.0.1:{port}", "--quiet", "posix", str(folder / "data")],
            env={**os.environ, "ROOT_ACCESS_KEY": access, "ROOT_SECRET_KEY": secret},
            stdout=log,
            stderr=log,
        )
        try:
            deadline = time.monotonic() + 20
            while True:
                try:
                    socket.create_connection(("127.0.0.1", port), timeout=1).close()
                    break
                except OSError:
                    if server.poll() is not None or time.monotonic() > deadline:
                        pytest.fail(f"versitygw did not start: {(folder / 'log').read_text()[-1000:]}")
                    time.sleep(0.05)
            yield f"http://127.0.0.1:{port}"
        finally:
            server.kill()
            server.wait()


@pytest.fixture
def s3_url(s3_gateway: str) -> str:
    """The URL of an empty store on the S3 server."""
    return f"s3://{BUCKET}/{uuid.uuid4().hex}?endpoint={s3_gateway}&region=us-east-1&allow_http=true"


@pytest.fixture(params=["file", "memory", "s3"])
def any_store_url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """The URL of an empty store: the test runs on each kind."""
    if request.param == "s3":
        return str(request.getfixturevalue("s3_url"))
    return "memory://" if request.param == "memory" else f"file://{tmp_path / 'store'}"
