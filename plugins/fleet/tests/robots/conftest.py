"""Fixtures of the tests with robots of another DDS: the robot's program, and a store with the real hall."""

from __future__ import annotations

from pathlib import Path

import pytest

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import Manifest
from firstfix.store.store import Store
from plugins.fleet.tests.robots import rust_robot
from tests.once_a_run import OnceARun


@pytest.fixture(scope="session")
def program(once_a_run: OnceARun) -> Path:
    reason = rust_robot.missing()
    if reason is not None:
        pytest.skip(reason)
    once_a_run.folder("rust-robot", lambda folder: rust_robot.build())
    return rust_robot.PROGRAM


@pytest.fixture(scope="session")
def hall_store(hall_directory: Path, once_a_run: OnceARun) -> Path:
    def publish(folder: Path) -> None:
        Catalog(Store.open(str(folder / "store"))).publish(
            "hall", hall_directory, Manifest.from_json((hall_directory / "manifest.json").read_bytes())
        )

    return once_a_run.folder("hall-store", publish) / "store"
