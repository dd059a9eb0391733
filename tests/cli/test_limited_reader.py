"""Files of strangers in the command line: their readers have limits, and their errors are words."""

from __future__ import annotations

import os
import resource
import signal
import time
from pathlib import Path

import laspy
import numpy as np
import pytest
from typer.testing import CliRunner

from firstfix.builds.config import BuildConfig
from firstfix.builds.limits import default_build_memory_bytes
from firstfix.builds.options import BuildOptions
from firstfix.errors import FirstfixError, MalformedData, NotFound, TooLarge
from firstfix_builder.job.build_job import BuildJob
from firstfix_builder.pipeline import read_source
from firstfix_cli import limited_reader
from firstfix_cli.limited_reader import read_scan
from firstfix_cli.main import app
from firstfix_cli.read_confined import read_confined


def las(path: Path) -> Path:
    cloud = laspy.create(point_format=6, file_version="1.4")
    cloud.header.scales = [0.001] * 3
    cloud.x, cloud.y, cloud.z = np.random.default_rng(0).uniform(-9, 9, (3, 300))
    cloud.write(path)
    return path


@pytest.fixture
def reader(monkeypatch: pytest.MonkeyPatch):
    """A reader of its own, which is the worse for what a test does to it."""
    limited_reader._reader.cache_clear()
    yield limited_reader
    limited_reader._reader().close()
    limited_reader._reader.cache_clear()


def _abort(path: Path, read: object) -> None:
    os.kill(os.getpid(), signal.SIGABRT)


def _take_memory(path: Path, read: object) -> None:
    np.ones(limited_reader.MAX_MEMORY_BYTES, np.uint8)


def _never_end(path: Path, read: object) -> None:
    used_s = int(time.process_time())
    resource.setrlimit(resource.RLIMIT_CPU, (used_s + 1, resource.RLIM_INFINITY))
    while True:
        pass


def test_the_scan_is_that_of_this_process(tmp_path: Path, reader):
    path = las(tmp_path / "a.laz")
    np.testing.assert_array_equal(read_scan(path).points, limited_reader.read_scan_file(path).points)


def test_a_reader_that_crashes_is_an_error_in_words_and_the_next_file_is_read(
    tmp_path: Path, reader, monkeypatch
):
    path = las(tmp_path / "a.laz")
    real = limited_reader._read
    for how in (_abort, _never_end):
        monkeypatch.setattr(limited_reader, "_read", how)
        with pytest.raises(MalformedData, match=r"a\.laz: its reader crashed, or took more than 60 s"):
            read_scan(path)
    monkeypatch.setattr(limited_reader, "_read", _take_memory)
    with pytest.raises(TooLarge, match=r"a\.laz: its reader needs more than [0-9]+ bytes"):
        read_scan(path)
    monkeypatch.setattr(limited_reader, "_read", real)
    assert len(read_scan(path).points) == 300


def test_a_bag_may_take_as_much_as_a_build():
    before = resource.getrlimit(resource.RLIMIT_DATA)
    with limited_reader.limited_memory():
        assert resource.getrlimit(resource.RLIMIT_DATA)[0] <= default_build_memory_bytes()
        with pytest.raises(MemoryError):
            np.empty(default_build_memory_bytes(), np.uint8)
    assert resource.getrlimit(resource.RLIMIT_DATA) == before


def test_damage_is_named_as_ever(tmp_path: Path, reader):
    path = las(tmp_path / "a.las")
    raw = bytearray(path.read_bytes())
    raw[100:104] = b"\xff" * 4
    path.write_bytes(raw)
    with pytest.raises(MalformedData, match=r"a\.las: LAS: .*variable length records"):
        read_scan(path)
    with pytest.raises(NotFound):
        read_scan(tmp_path / "none.las")


def refuse(*given: object, **named: object) -> None:
    raise AssertionError("read in this process")


def test_what_the_sandbox_read_is_not_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path = las(tmp_path / "a.las")
    config: dict[str, object] = {"level": False}
    job = BuildJob(path, None, config, tmp_path / "work", lambda stage, fraction: None, lambda: False)
    read_confined(job, BuildOptions(work=tmp_path / "work"))
    monkeypatch.setattr("firstfix_builder.sources.write_level_map.read_parts", refuse)
    read_source(path, BuildConfig.parse(config), tmp_path / "work" / "build")


def test_a_build_reads_its_map_in_the_sandbox(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """This process parses nothing of it."""
    monkeypatch.setattr("firstfix_builder.sources.write_level_map.read_parts", refuse)
    path = las(tmp_path / "a.las")
    raw = bytearray(path.read_bytes())
    raw[100:104] = b"\xff" * 4
    path.write_bytes(raw)
    options = ["--map-id", "a", "--store", str(tmp_path / "store"), "--work", str(tmp_path / "work")]
    ended = CliRunner().invoke(app, ["build", str(path), *options])
    assert isinstance(ended.exception, FirstfixError)
    assert "variable length records" in str(ended.exception)
