"""The map of the drill: a small one, with a cloud for viewers as large as one answer may give."""

from __future__ import annotations

import dataclasses
import shutil
from dataclasses import dataclass
from pathlib import Path

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import CLOUD_INDEX, CLOUD_POINTS, FileEntry, Manifest
from firstfix.store.sha256 import sha256_of

from ...common.load import Body
from ...common.small_map import make_small_map, query_of

MAP = "yard"
CLOUD_BYTES = 4_000_000  # 500,000 points


@dataclass(frozen=True)
class Yard:
    """The map in a store.

    Attributes:
        versions: two, that answer alike.
        query: a scan.
    """

    versions: tuple[str, str]
    query: Body

    @property
    def cloud_path(self) -> str:
        return f"/maps/{MAP}/versions/{self.versions[0]}/cloud/points?first=0&count=500000"


def publish_yard(catalog: Catalog, folder: Path) -> Yard:
    """Build the map in an empty folder and publishes two versions of it."""
    built = make_small_map(folder / "map")
    query = query_of(built)
    versions = []
    for name in ("one", "two"):
        version = folder / name
        shutil.copytree(built, version)
        points = (version / CLOUD_POINTS).read_bytes()
        times = CLOUD_BYTES // len(points) + 1
        (version / CLOUD_POINTS).write_bytes((points * times)[:CLOUD_BYTES])
        (version / "note.txt").write_text(name)
        manifest = Manifest.from_json((version / "manifest.json").read_bytes())
        changed = {
            one: FileEntry((version / one).stat().st_size, sha256_of(version / one))
            for one in (CLOUD_INDEX, CLOUD_POINTS, "note.txt")
        }
        manifest = dataclasses.replace(manifest, files={**manifest.files, **changed})
        versions.append(catalog.publish(MAP, version, manifest))
    return Yard((versions[0], versions[1]), query)
