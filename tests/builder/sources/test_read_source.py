"""Which reader takes a source, and readers of other packages, which come through an entry point."""

from __future__ import annotations

import sys
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from firstfix.builds.config import BuildConfig
from firstfix.errors import MalformedData, UnsupportedFormat
from firstfix.transform import from_quaternion, inverse, transform_points
from firstfix_builder.job.patch_source import PATCH_SOURCE_FILE
from firstfix_builder.sources.read_source import readers
from firstfix_builder.stage_results import LevelMap
from tests.builder.sources.read_map import program_folders as written
from tests.builder.stages import stages_below

_RNG = np.random.default_rng(2)
PLACE = np.concatenate(
    [_RNG.uniform([0, 0, 0], [20, 20, 0.01], (4000, 3)), _RNG.uniform([0, 0, 0], [20, 0.01, 3], (900, 3))]
)
# A kind of source of its own: a folder of numbers that end in .heights.
PLUGIN = """
from pathlib import Path

import numpy as np

from firstfix.errors import MalformedData
from firstfix_builder.sources.read_map.map_data import MapData
from firstfix_builder.sources.write_level_map import write_level_map


def read_heights(path):
    found = list(path.glob("*.heights"))
    if not found:
        raise MalformedData("no heights")
    return MapData(points=np.concatenate([np.loadtxt(one) for one in found]) + RAISED_M)


class HeightsReader:
    def can_read(self, path):
        return path.is_dir() and path.name == "heights"

    def read(self, path, trajectory, reading):
        def produce(out):
            write_level_map(path, trajectory, reading.config, out, read=read_heights)

        return reading.stage(path, trajectory, produce)
"""
CONFIG = BuildConfig.parse({"level": False, "clean": {"min_neighbours": 0}})


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str, float], None]]:
    """Installs a version of a package with a reader, whose maps are raised by some metres."""

    def install(version: str, raised_m: float) -> None:
        folder = tmp_path / f"site-{version}"
        record = folder / f"heights-{version}.dist-info"
        record.mkdir(parents=True)
        (record / "METADATA").write_text(f"Metadata-Version: 2.1\nName: heights\nVersion: {version}\n")
        (record / "entry_points.txt").write_text("[firstfix.sources]\nheights = heights_reader:READER\n")
        (folder / "heights_reader.py").write_text(
            f"{PLUGIN}\n\nRAISED_M = {raised_m}\nREADER = HeightsReader()\n"
        )
        monkeypatch.syspath_prepend(folder)
        monkeypatch.delitem(sys.modules, "heights_reader", raising=False)
        readers.cache_clear()

    yield install
    readers.cache_clear()


def read(source: Path, work: Path, trajectory: Path | None = None) -> LevelMap:
    with stages_below(work, CONFIG) as stages:
        return stages.read_map(source, trajectory)


def heights(folder: Path) -> Path:
    """Writes a source for the package's reader."""
    source = folder / "heights"
    source.mkdir(parents=True)
    np.savetxt(source / "place.heights", PLACE)
    return source


def packed(folder: Path, archive: Path) -> Path:
    with zipfile.ZipFile(archive, "w") as made:
        for path in sorted(one for one in folder.rglob("*") if one.is_file()):
            made.write(path, path.relative_to(folder.parent))
    return archive


def test_a_reader_of_another_package_reads_its_kind_of_source(install, tmp_path: Path):
    source = heights(tmp_path)
    with pytest.raises(UnsupportedFormat, match="heights: the folder is of none of"):
        read(source, tmp_path / "work")
    install("1.0", 0.0)
    found = read(source, tmp_path / "work")
    assert len(found.points) > 1000
    assert found.points[:, 2].min() == pytest.approx(0.0, abs=0.1)
    archive, poses = packed(source, tmp_path / "packed.zip"), tmp_path / "poses.txt"
    assert read(archive, tmp_path / "work").digest == found.digest
    np.savetxt(poses, np.tile(np.eye(4)[:3].ravel(), (3, 1)))
    driven = read(archive, tmp_path / "work", poses).trajectory
    assert driven is not None
    assert len(driven) == 3
    (source / "place.heights").unlink()
    with pytest.raises(MalformedData, match="heights: no heights"):
        read(source, tmp_path / "work")


HALF = np.array_split(PLACE + [8, 8, 0], 2)
RUN = [from_quaternion([4.0 + 2 * n, 9.0, 1.2], [0, 0, 0, 1]) for n in range(6)]
SCANS = [transform_points(inverse(T), PLACE[n::6]) for n, T in enumerate(RUN)]
FOLDERS: dict[str, Callable[[Path], None]] = {
    "Autoware": lambda folder: written.write_divided_map(folder, PLACE),
    "FAST-LIO": lambda folder: written.write_intervals(folder, HALF),
    "KISS-SLAM": lambda folder: written.write_kiss_slam(folder, HALF, RUN, PLACE),
    "RTAB-Map": lambda folder: written.write_rtabmap(folder, PLACE, RUN),
    "HDMapping": lambda folder: written.write_hdmapping(folder, HALF, [RUN[:3], RUN[3:]]),
    "SC-LIO-SAM": lambda folder: written.write_sc_lio_sam(folder, SCANS, RUN),
    "hdl_graph_slam": lambda folder: written.write_hdl_graph_slam(folder, SCANS, RUN),
}


@pytest.mark.parametrize("program", FOLDERS)
def test_a_programs_folder_is_read_from_an_archive_too(tmp_path: Path, program: str):
    source = tmp_path / "their_map"
    FOLDERS[program](source)
    found = read(source, tmp_path / "work")
    assert len(found.points) > 1000
    assert read(packed(source, tmp_path / "packed.zip"), tmp_path / "work").digest == found.digest


def test_another_version_of_a_reader_reads_a_source_anew(install, tmp_path: Path):
    source = heights(tmp_path)
    install("1.0", 0.0)
    archive = packed(source, tmp_path / "packed.zip")
    first = [read(one, tmp_path / "work") for one in (source, archive)]
    install("1.1", 1.0)
    second = [read(one, tmp_path / "work") for one in (source, archive)]
    for before, after in zip(first, second, strict=True):
        assert after.key != before.key
        assert after.points[:, 2].min() == pytest.approx(1.0, abs=0.1)


def test_other_sources_are_read_as_without_the_package(install, tmp_path: Path):
    np.save(tmp_path / "cloud.npy", PLACE)
    before = read(tmp_path / "cloud.npy", tmp_path / "work")
    install("1.0", 0.0)
    assert read(tmp_path / "cloud.npy", tmp_path / "work").key == before.key


@pytest.mark.parametrize("within", ["archive", "archive in archive"])
def test_a_patch_or_an_archive_within_an_archive_is_not_read(tmp_path: Path, within: str):
    folder = tmp_path / "inside"
    folder.mkdir()
    if within == "archive":  # who may upload a map must not hand in the version that a patch is held against
        (folder / PATCH_SOURCE_FILE).write_text("{}")
    else:
        np.save(folder / "cloud.npy", PLACE)
        packed(folder, tmp_path / "inner.zip")
        (folder / "cloud.npy").unlink()
        (tmp_path / "inner.zip").rename(folder / "inner.zip")
    archive = packed(folder, tmp_path / "map.zip")
    with pytest.raises(UnsupportedFormat, match="0 map files instead of one"):
        read(archive, tmp_path / "work")


def test_readers_are_asked_from_the_rarest_to_the_plainest(install):
    install("1.0", 0.0)
    assert list(readers()) == [
        "patch",
        "archive",
        "sessions",
        "heights of heights 1.0: heights_reader:READER",
        "map",
    ]
