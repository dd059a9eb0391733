"""Fixtures that several packages share: real object stores; and what holds for the whole run."""

from __future__ import annotations

import gc
import os
import secrets
import sys
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import hypothesis
import pytest

from tests.servers import free_port, running_versitygw

if TYPE_CHECKING:  # a plugin below: pytest wants to be the first to import it
    from tests.toxiproxy import Link, Toxiproxy

pytest_plugins = [
    "tests.harness.time_limits",
    "tests.harness.running_tests",
    "tests.harness.dead_workers",
    "tests.harness.left_behind",
    "tests.harness.skips",
    "tests.harness.processor_time",
    "tests.harness.levels",
    "tests.frequent_snapshots",
    "tests.patient_clients",
    "tests.one_tls_context",
    "tests.once_a_run",
    "tests.small_world",
    "tests.changed_yard",
    "tests.real_hall",
    "tests.cloud_servers",
    "tests.toxiproxy",
]

BUCKET = "firstfix-tests"

# NumPy, which reads them when it is first imported, comes later. xdist's workers share the cores among
# themselves: threads of a library that wait for each other in a loop would only take them away.
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

# The tests start hundreds of processes. Where they may not keep bytecode, each compiles all it imports anew.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# A process that is kept ready for a build costs seconds of a processor: few tests look at it.
os.environ["FIRSTFIX_BUILD_READY"] = "false"

# Programs that tests start import `tests.…` as the tests do.
os.environ["PYTHONPATH"] = os.pathsep.join(
    [str(Path(__file__).parent), *filter(None, [os.environ.get("PYTHONPATH")])]
)

# The same examples in every run, and no limit on how long one may take.
hypothesis.settings.register_profile("firstfix", deadline=None, derandomize=True, database=None)
hypothesis.settings.load_profile("firstfix")


def pytest_collection_finish() -> None:
    """Leaves what stays for the whole run out of garbage collection.

    With these half a million objects, each full collection took a third of a second of a processor.
    """
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def own_states(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Keeps what commands remember for their user among the tests' own files."""
    os.environ["XDG_STATE_HOME"] = str(tmp_path_factory.mktemp("states"))


@pytest.fixture(scope="session")
def s3_gateway(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A real S3 server on this machine, with an empty bucket; its credentials stand in the environment."""
    folder = tmp_path_factory.mktemp("s3")
    (folder / "data" / BUCKET).mkdir(parents=True)
    port, access, secret = free_port(), secrets.token_hex(8), secrets.token_hex(16)
    with pytest.MonkeyPatch.context() as patch, running_versitygw(folder, port, access, secret):
        patch.setenv("AWS_ACCESS_KEY_ID", access)
        patch.setenv("AWS_SECRET_ACCESS_KEY", secret)
        for name in ("AWS_SESSION_TOKEN", "AWS_PROFILE", "AWS_ENDPOINT_URL"):
            patch.delenv(name, raising=False)
        yield f"http://127.0.0.1:{port}"


@pytest.fixture
def s3_url(s3_gateway: str) -> str:
    """The URL of an empty store on the S3 server."""
    return f"s3://{BUCKET}/{uuid.uuid4().hex}?endpoint={s3_gateway}&region=us-east-1&allow_http=true"


@pytest.fixture
def broken_s3(s3_gateway: str, s3_url: str, toxiproxy: Toxiproxy) -> tuple[str, Link]:
    """The URL of ``s3_url``'s store over a link that can be broken, and the link."""
    link = toxiproxy.link(urlsplit(s3_gateway).netloc)
    return s3_url.replace(s3_gateway, f"http://{link.address}"), link


@pytest.fixture(params=["file", "memory", "s3", pytest.param("azure", marks=pytest.mark.slow)])
def any_store_url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """The URL of an empty store: the test runs on each kind."""
    if request.param in ("s3", "azure"):
        return str(request.getfixturevalue(f"{request.param}_url"))
    return "memory://" if request.param == "memory" else f"file://{tmp_path / 'store'}"
