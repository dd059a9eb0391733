"""The reader of an archive: its folder is unpacked, and read as any other."""

from __future__ import annotations

from pathlib import Path

from ..stage_files import link
from ..stage_results import LevelMap
from .read_map.archive import SUFFIX, unpack
from .reading import Reading


class ArchiveReader:
    """Reads what an archive holds."""

    def can_read(self, path: Path) -> bool:
        """Whether it is a zip file."""
        return path.suffix.lower() == SUFFIX and path.is_file()

    def read(self, path: Path, trajectory: Path | None, reading: Reading) -> LevelMap:
        """The map of its folder."""

        def produce(out: Path) -> None:
            folder = unpack(path, out.parent / "unpacked")  # removed when the stage is done
            for file in reading.within(folder, trajectory).directory.iterdir():
                link(file, out / file.name)

        return reading.stage(path, trajectory, produce, held_out=reading.config.self_test.held_out)
