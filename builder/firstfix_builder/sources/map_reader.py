"""The reader of a map file, a folder of a SLAM package, or a folder of scans."""

from __future__ import annotations

from pathlib import Path

from ..stage_results import LevelMap
from .read_map.map_of_scans import is_map_of_scans
from .reading import Reading
from .write_level_map import write_level_map


class MapReader:
    """Reads one map by ``read_map``."""

    def can_read(self, path: Path) -> bool:
        """True: it says of any source why it cannot be read."""
        return True

    def read(self, path: Path, trajectory: Path | None, reading: Reading) -> LevelMap:
        """The map, as its file or folder has it."""

        def produce(out: Path) -> None:
            write_level_map(path, trajectory, reading.config, out, on_posed_cloud=reading.on_posed_cloud)

        held_out = reading.config.self_test.held_out if is_map_of_scans(path) else None
        return reading.stage(path, trajectory, produce, held_out=held_out)
