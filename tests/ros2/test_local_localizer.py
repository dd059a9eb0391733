"""The localizer of a robot without a service: a process of its own, which gives a service's answers."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.catalog.manifest import FILE_NAME
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.errors import (
    CorruptVersion,
    DeadlineExceeded,
    IncompatibleVersion,
    InvalidOption,
    NotFound,
    WorkerLost,
)
from firstfix_ros.on_board.local_localizer import LocalLocalizer
from tests.cpp.stored_versions import damaged, rewritten, stored
from tests.waiting import LIMIT_S, wait_until

CLIENTS = Path(__file__).resolve().parents[2] / "clients" / "ros2"


@pytest.fixture(scope="module")
def folder(small_version, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return stored(small_version.directory, tmp_path_factory.mktemp("versions"))


@pytest.fixture(scope="module")
def local(folder: Path) -> Iterator[LocalLocalizer]:
    with LocalLocalizer(folder, "yard", timeout_s=LIMIT_S) as running:
        yield running


def told(answer: Localization) -> dict[str, object]:
    return {**answer.to_mapping(), "timings_ms": {}}


def test_its_answers_are_those_of_a_service(local: LocalLocalizer, folder: Path, small_scans):
    localizer = Localizer(MapIndex.load(folder))
    for scan, T_map_sensor in small_scans[:3]:
        for options in (LocalizeOptions(), LocalizeOptions(gravity=-T_map_sensor[2, :3])):
            own = localizer.localize(scan, options).of_version("yard", folder.name, provisional=False)
            assert told(local(scan, options)) == told(own)


def test_an_error_is_raised_here_and_the_next_scan_answered(local: LocalLocalizer, small_scans):
    scan = small_scans[0][0]
    with pytest.raises(InvalidOption, match="a twist needs the times"):
        local(scan, LocalizeOptions(twist=np.zeros(6)))
    assert local(scan, LocalizeOptions()).verdict.value == "localized"


def process_of(localizer: LocalLocalizer) -> int:
    assert localizer._process is not None
    return localizer._process.pid


def test_a_process_that_is_lost_is_started_again(folder: Path, small_scans):
    scan = small_scans[0][0]
    with LocalLocalizer(folder, "yard", timeout_s=LIMIT_S) as localizer:
        first = process_of(localizer)
        os.kill(first, signal.SIGKILL)
        with pytest.raises(WorkerLost):
            localizer(scan, LocalizeOptions())
        assert localizer(scan, LocalizeOptions()).verdict.value == "localized"
        assert process_of(localizer) != first


def test_one_that_hangs_is_ended(folder: Path, small_scans):
    with LocalLocalizer(folder, "yard", timeout_s=0.2) as localizer:
        frozen = process_of(localizer)
        os.kill(frozen, signal.SIGSTOP)
        with pytest.raises(DeadlineExceeded):
            localizer(small_scans[0][0], LocalizeOptions())
        assert not Path(f"/proc/{frozen}").exists()


def test_it_ends_with_its_node_however_that_ends(folder: Path):
    program = (
        "import sys, time; from pathlib import Path; "
        "from firstfix_ros.on_board.local_localizer import LocalLocalizer; "
        "localizer = LocalLocalizer(Path(sys.argv[1]), 'yard', timeout_s=9); "
        "print(localizer._process.pid, flush=True); time.sleep(1000)"
    )
    command = [sys.executable, "-c", program, str(folder)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, env=os.environ | {"PYTHONPATH": str(CLIENTS)}
    ) as node:
        assert node.stdout is not None
        process = Path(f"/proc/{int(node.stdout.readline())}")
        assert process.exists()
        node.kill()
    wait_until(lambda: not process.exists())


def test_folders_that_cannot_be_used(folder: Path, tmp_path: Path):
    name = "engine.json"
    cases = (
        (tmp_path / "none", lambda at: (at / FILE_NAME).unlink(), NotFound),
        (tmp_path / "cut", lambda at: (at / name).write_bytes((at / name).read_bytes()[:-1]), CorruptVersion),
        (tmp_path / ("0" * 64), lambda at: None, CorruptVersion),
        (tmp_path / "old", lambda at: (at / FILE_NAME).write_text('{"format": 8}'), IncompatibleVersion),
        (tmp_path / "wrong", lambda at: rewritten(at, name, b"{}"), CorruptVersion),
    )
    for target, change, error in cases:
        with pytest.raises(error):
            LocalLocalizer(damaged(folder, target, change), "yard", timeout_s=LIMIT_S)


def test_a_robot_without_the_engine_is_told_what_to_install(folder: Path, monkeypatch, tmp_path: Path):
    """As where only the client is installed."""
    (tmp_path / "sitecustomize.py").write_text("import sys; sys.modules['firstfix.engine'] = None")
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{CLIENTS}")
    with pytest.raises(ModuleNotFoundError, match=r"local needs firstfix with its engine: pip install"):
        LocalLocalizer(folder, "yard", timeout_s=LIMIT_S)
