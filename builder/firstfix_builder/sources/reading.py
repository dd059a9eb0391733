"""The protocol of the readers of sources, and what each is given."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol, TypeAlias

from firstfix.builds.config import BuildConfig
from firstfix.errors import UnsupportedFormat

from ..execution.build_trace import within_a_stage
from ..execution.stage_runner import Progress, StageRunner
from ..stage_results import IndexedMap, LevelMap, MapMesh
from .read_map.posed_cloud import OnPosedCloud
from .read_map.read_map import content_hash


class SourceReader(Protocol):
    """A reader of one kind of source.

    It may be one of another package: see ``read_source``. What it reads is untrusted. ``read`` does all of
    its work in ``reading.stage``, which is run in the sandbox, and ``can_read`` is called outside, too.
    """

    def can_read(self, path: Path) -> bool:
        """Whether a source is of this kind, by the names of its files alone."""
        ...

    def read(self, path: Path, trajectory: Path | None, reading: Reading) -> LevelMap:
        """The map of a source, in its levelled frame.

        Args:
            trajectory: poses of the mapping run, if they are not in the source.

        Raises:
            InputError: the source or the trajectory cannot be read.
            BuildFailed: a finding refuses the map.
        """
        ...


class MapStages(Protocol):
    """The stages that make the index of a map that was read."""

    def reconstruct_mesh(self, read: LevelMap) -> MapMesh:
        """The surface of the map alone, which is less work."""
        ...

    def index_map(self, read: LevelMap) -> IndexedMap:
        """All that scans are localized with, but the calibration."""
        ...


StagesFor: TypeAlias = Callable[[BuildConfig, Progress], MapStages]


@dataclass(frozen=True)
class Reading:
    """Means that a reader is given besides the source.

    Attributes:
        runner: runs a stage unless its result is cached.
        threads: run the work of a stage.
        stages_for: makes the stages of another build, by its config and progress.
        reader: name of the reader, of another package with its version: a part of the stage's key.
        readers: by name, of sources within the source.
        on_posed_cloud: called with a cloud that has poses, as soon as nothing refuses it and before it is
            cleaned; None: nobody waits for it. It is not called where the result of reading is cached.
    """

    runner: StageRunner
    config: BuildConfig
    threads: Executor
    stages_for: StagesFor
    reader: str = ""
    readers: Mapping[str, SourceReader] = field(default_factory=dict)
    on_posed_cloud: OnPosedCloud | None = None

    def with_config(self, config: BuildConfig) -> Reading:
        """The same by another config, of a part of the map: without progress, and nobody waits for it."""
        quiet = replace(self.runner, progress=lambda stage, fraction: None)
        return replace(self, config=config, runner=quiet, on_posed_cloud=None)

    def first_of(self, readers: Mapping[str, SourceReader], path: Path, trajectory: Path | None) -> LevelMap:
        """The map of a source, by the first of the readers that can; sources within it by those after it.

        Raises:
            UnsupportedFormat: none of them can.
            InputError, BuildFailed: as the reader says.
        """
        left = dict(readers)
        for name, reader in readers.items():
            del left[name]
            if reader.can_read(path):
                return reader.read(path, trajectory, replace(self, reader=name, readers=left))
        raise UnsupportedFormat(f"{path.name}: there is no reader for it")

    def within(self, path: Path, trajectory: Path | None) -> LevelMap:
        """The map of a source within the source; raises as ``first_of`` does."""
        with within_a_stage():
            return self.first_of(self.readers, path, trajectory)

    def stage(
        self, path: Path, trajectory: Path | None, produce: Callable[[Path], None], **besides: Any
    ) -> LevelMap:
        """The first stage of a build, unless its result is cached.

        Args:
            produce: writes the files of ``LevelMap`` into the folder that it is given.
            besides: what decides the result besides the source, the trajectory and the config of reading.
        """
        inputs = {"source": content_hash(path)}
        if trajectory is not None:
            inputs["trajectory"] = content_hash(trajectory)
        chosen = {
            "readers": [self.reader, *self.readers],  # those after it may read what is within
            "axis": self.config.axis,
            "scale": self.config.scale,
            "trajectory_mount_height_m": self.config.trajectory_mount_height_m,
            "level": self.config.level,
            "clean": self.config.clean.model_dump(mode="json"),
            "names": [one.name for one in (path, trajectory) if one is not None],
            **besides,
        }
        return LevelMap.of(self.runner.stage("read_map", inputs, chosen, produce))
