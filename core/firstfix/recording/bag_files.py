"""The files of a bag: one alone, or those of a ROS 2 bag's folder, unpacked where they are compressed."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import MalformedData, UnsupportedFormat
from .compression import unpack_file

ENDINGS = (".bag", ".db3", ".mcap", ".db3.zstd", ".mcap.zstd")
_METADATA = "metadata.yaml"
_INFORMATION = "rosbag2_bagfile_information"


@dataclass(frozen=True)
class BagFiles:
    """Files to open, and what a user should know of them.

    Attributes:
        paths: plain files, in no order.
        notes: a sentence each.
    """

    paths: list[Path]
    notes: list[str]


@contextmanager
def bag_files(path: Path, others: tuple[str, ...] = ()) -> Iterator[BagFiles]:
    """Find the files of a bag. Those that are compressed as a whole are unpacked into a temporary folder.

    Args:
        path: the bag's only file, or its folder, with ``metadata.yaml`` or not.
        others: endings of files that are taken beside those of bags.

    Raises:
        UnsupportedFormat: the ending is not that of a bag.
        TooLarge: the unpacked files take over half of the free space in the temporary folder.
        MalformedData: ``metadata.yaml`` is damaged, or a file is missing, damaged or cut off.
    """
    files = _files_in(path) if path.is_dir() else BagFiles([_checked(path, others)], [])
    if not any(one.suffix == ".zstd" for one in files.paths):
        yield files
        return
    with tempfile.TemporaryDirectory(prefix="firstfix-bag-") as made:
        left = shutil.disk_usage(made).free // 2
        plain = []
        for one in files.paths:
            plain.append(unpack_file(one, Path(made), left) if one.suffix == ".zstd" else one)
            left -= plain[-1].stat().st_size if one.suffix == ".zstd" else 0
        yield BagFiles(plain, files.notes)


def _checked(path: Path, others: tuple[str, ...]) -> Path:
    if path.name.endswith(".bag.active"):
        raise MalformedData(
            f"its recorder ended before it wrote the index. `rosbag reindex {path.name}` of ROS 1 writes it; "
            f"then name the file {path.name.removesuffix('.active')}"
        )
    if not path.name.lower().endswith(ENDINGS) and path.suffix.lower() not in others:
        raise UnsupportedFormat(
            "a bag is a .bag, .db3 or .mcap file, also with .zstd, or a ROS 2 bag's folder"
            + (f"; a capture ends in {' or '.join(others[:2])}" if others else "")
        )
    return path


def _files_in(folder: Path) -> BagFiles:
    described = folder / _METADATA
    if not described.exists():
        found = sorted(one for one in folder.iterdir() if one.name.endswith(ENDINGS[1:]) and one.is_file())
        if not found:
            raise MalformedData(f"no {_METADATA}, and no .mcap or .db3 file: not the folder of a ROS 2 bag")
        return BagFiles(found, [f"no {_METADATA}: the recording was cut off; what its files hold was read"])
    names = _described(described)
    paths = [folder / Path(name).name for name in names]
    for one in paths:
        if not one.is_file():
            raise MalformedData(f"the file {one.name} is missing")
        if not one.name.endswith(ENDINGS[1:]):
            raise UnsupportedFormat(
                f"{one.name}: the files of a ROS 2 bag end in .mcap or .db3, also with .zstd"
            )
    return BagFiles(paths, _unnamed_notes(folder, paths))


def _unnamed_notes(folder: Path, paths: list[Path]) -> list[str]:
    """Names the files of a bag that its description does not: a recorder that is killed leaves them so."""
    known = {one.name.removesuffix(".zstd") for one in paths}
    unnamed = sorted(
        one.name
        for one in folder.iterdir()
        if one.name.endswith(ENDINGS[1:]) and one.name.removesuffix(".zstd") not in known
    )
    if not unnamed:
        return []
    return [
        f"not named in {_METADATA}, and not read: {', '.join(unnamed)}. `ros2 bag reindex` names all files"
    ]


def _described(path: Path) -> list[str]:
    """Names of a bag's files as ``metadata.yaml`` says them. All else the files say themselves."""
    import yaml

    try:
        described: Any = yaml.safe_load(path.read_bytes())
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise MalformedData(f"{_METADATA}: {error}") from error
    information = described.get(_INFORMATION) if isinstance(described, Mapping) else None
    if not isinstance(information, Mapping):
        raise MalformedData(f"{_METADATA}: no {_INFORMATION}")
    names = information.get("relative_file_paths")
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise MalformedData(f"{_METADATA}: no relative_file_paths")
    return names
