"""The version that a build may keep something of."""

from __future__ import annotations

import json
import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import firstfix
from firstfix.builds.config import BuildConfig
from firstfix.catalog.manifest import FILE_NAME, MADE_BY_FILE, SURFACE_FILE, Manifest
from firstfix.engine.calibration import Calibration
from firstfix.engine.config import EngineConfig
from firstfix.engine.index import CALIBRATION_FILE
from firstfix.engine.retrieval.cascade import Templates
from firstfix.errors import FirstfixError

from ..execution.source_hash import source_hash
from ..stage_files import write_json

_log = logging.getLogger(__name__)
REBUILT = "rebuilt"  # of the manifest's record of the source
_MAPPING_RUN = "mapping_run"  # of what made it


@dataclass(frozen=True)
class BaseVersion:
    """The version before, made from another source by the same program and config.

    Attributes:
        directory: its files.
    """

    directory: Path
    manifest: Manifest

    @classmethod
    def of(cls, directory: Path | None, config: BuildConfig, source: str) -> BaseVersion | None:
        """The base of a build; None, and a line in the log, if nothing of it may be kept.

        Args:
            directory: its files, as ``job.base_source`` fetches them; None: there is none.
            source: sha256 of the build's source as it was read.
        """
        if directory is None:
            return None
        try:
            manifest = Manifest.from_json((directory / FILE_NAME).read_bytes())
            reason = _reason_against(directory, manifest, config, source)
            if reason is None:
                return cls(directory, manifest)
        except (OSError, ValueError, FirstfixError) as error:
            reason = f"it cannot be read ({type(error).__name__})"
        _log.info("nothing is kept of the version before: %s", reason)
        return None

    @property
    def digest(self) -> str:
        """Digest that names the version."""
        return self.manifest.digest

    @property
    def engine(self) -> EngineConfig:
        """Its engine's parameters."""
        return EngineConfig.load(self.directory)

    @property
    def templates(self) -> Templates:
        """Its templates."""
        return Templates.load(self.directory, self.engine.descriptor.make())

    @property
    def calibration(self) -> Calibration:
        """Its calibration, its own or kept."""
        return Calibration.from_mapping(json.loads((self.directory / CALIBRATION_FILE).read_text()))

    @property
    def mapping_run(self) -> str | None:
        """Hash of the mapping run that carved its free space (``carve.hash_of_run``); None: it has none."""
        found: str | None = _made_by(self.directory).get(_MAPPING_RUN)
        return found

    @property
    def rebuilt(self) -> dict[str, Any]:
        """``Kept.record`` of the version itself; empty if it was built from nothing."""
        found: dict[str, Any] = self.manifest.source.get(REBUILT) or {}
        return found


def write_made_by(directory: Path, mapping_run: str | None) -> None:
    """Write what made a version: another program keeps nothing of it, another mapping run no free space.

    Args:
        mapping_run: see ``BaseVersion.mapping_run``.
    """
    write_json(directory / MADE_BY_FILE, {**_this_program(), _MAPPING_RUN: mapping_run})


def _made_by(directory: Path) -> dict[str, Any]:
    return dict(json.loads((directory / MADE_BY_FILE).read_text()))


def _this_program() -> dict[str, str]:
    return {"release": firstfix.__version__, "code": source_hash()}


def _reason_against(directory: Path, manifest: Manifest, config: BuildConfig, source: str) -> str | None:
    """The reason why nothing of a version may be kept."""
    if manifest.digest != config.base:
        return "it is another one than the build names"
    if manifest.provisional or not manifest.self_test.get("queries"):
        return "it was not tested"
    if manifest.source.get("sha256") == source:
        return "it has the same source, so a build from nothing costs little"
    before, now = dict(manifest.config), config.to_mapping()
    for one in (before, now):
        one.pop("base", None)
    if before != now:
        return "it has another config"
    if not (directory / SURFACE_FILE).exists() or not (directory / MADE_BY_FILE).exists():
        return "it is of an older release"
    if not _this_program().items() <= _made_by(directory).items():
        return "another release made it"
    if EngineConfig.load(directory).descriptor.kind != "occupancy":
        return "its templates are those of the paper's method"
    return None
