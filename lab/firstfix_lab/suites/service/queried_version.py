"""A built version, and scans taken in its map, as the suite asks for them."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from zlib import crc32

import numpy as np

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import Manifest
from firstfix.engine.config import ENGINE_FILE
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.scan.descriptor_parameters import DescriptorParameters
from firstfix.scan.scan import Scan
from firstfix.store.store import Store
from firstfix_builder.execution.stage_cache import StageCache

from ...common.worlds import BenchWorld
from ..robust.cases import CASES
from ..robust.queries import queries_of
from ..robust.versions import Versions

SEED = 5
CASE = next(case for case in CASES if case.name == "all at once")


@dataclass(frozen=True)
class QueriedVersion:
    """A built version, and scans to query it with.

    Attributes:
        version: folder of a version's files, without a manifest.
    """

    name: str
    version: Path
    templates: int
    scans: list[Scan]

    def localizer(self) -> Localizer:
        return Localizer(MapIndex.load(self.version))

    def parameters(self) -> DescriptorParameters:
        """The parameters with which a robot describes scans for it."""
        return DescriptorParameters.from_engine(json.loads((self.version / ENGINE_FILE).read_text()))

    def publish(self, store_url: str, map_id: str, scratch: Path, mark: str = "") -> str:
        """Its digest.

        Args:
            mark: written into the version, so that another mark makes another version, of other files.
        """
        folder = scratch / f"{map_id}-{mark}"
        shutil.copytree(self.version, folder)
        (folder / "manifest.json").unlink(missing_ok=True)
        (folder / "mark.txt").write_text(mark)
        made = Manifest.for_directory(folder)
        version = Catalog(Store.open(store_url)).publish(map_id, folder, made)
        shutil.rmtree(folder)
        return version


def make_queried_version(world: BenchWorld, work: Path, count: int) -> QueriedVersion:
    """Build the world's map, and takes scans in it with everything perturbed at once."""
    files = world.make(StageCache(work))
    versions = Versions(world, files, work / world.name)
    index = versions.localizer(None).index
    rng = np.random.default_rng([SEED, crc32(world.name.encode())])
    taken = queries_of(CASE, index, versions.sensor(None), files, (), count, rng)
    sensor = versions.sensor(None).name
    folder = work / world.name / sensor / "version"
    return QueriedVersion(world.name, folder, versions.templates[sensor], [scan for scan, _ in taken])
