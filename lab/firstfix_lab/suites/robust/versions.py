"""A world's versions, one a template sensor: built when first asked for, then loaded."""

from __future__ import annotations

import sys
from pathlib import Path

from firstfix.builds.config import BuildConfig
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.sensor import SensorModel, preset
from firstfix_builder.pipeline import build_version

from ...common.worlds import BenchWorld, WorldFiles


class Versions:
    """Built versions of one world, for each sensor preset.

    Args:
        files: of the world.
        work: folder of the builds; their stage caches make a second run quick.
    """

    def __init__(self, world: BenchWorld, files: WorldFiles, work: Path) -> None:
        self._world, self._files, self._work = world, files, work
        self._loaded: dict[str | None, Localizer] = {}

    def localizer(self, sensor: str | None) -> Localizer:
        """The localizer for a preset's templates. None means the world's own sensor."""
        if sensor not in self._loaded:
            config = self._world.config if sensor is None else self._world.config | {"sensor": sensor}
            name = BuildConfig.parse(config).sensor_model.name
            print(f"{self._world.name}: templates for {name}", file=sys.stderr, flush=True)
            built = build_version(
                self._files.source,
                BuildConfig.parse(config),
                self._work / name,
                trajectory=self._files.map.trajectory,
            )
            self._loaded[sensor] = Localizer(MapIndex.load(built.directory))
        return self._loaded[sensor]

    def sensor(self, name: str | None) -> SensorModel:
        """A preset; None: the world's own."""
        return BuildConfig.parse(self._world.config).sensor_model if name is None else preset(name)

    @property
    def templates(self) -> dict[str, int]:
        """Sensor to the number of templates, of those that were asked for."""
        return {
            self.sensor(name).name: len(localizer.index.cascade.templates.position_m)
            for name, localizer in self._loaded.items()
        }
