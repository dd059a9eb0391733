"""The provisional version of a map with a trajectory: made, tested and handed on before it is cleaned."""

from __future__ import annotations

import logging
import shutil
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, field
from pathlib import Path

from firstfix.builds.config import BuildConfig
from firstfix.engine.calibration import Calibration
from firstfix.engine.false_accept_bound import FILE_NAME as BOUND_FILE
from firstfix.engine.index import CALIBRATION_FILE, MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.errors import BuildFailed
from firstfix.transform import inverse

from ..self_test.results import SelfTest
from ..sources.read_map.held_out import HeldOut
from ..sources.read_map.posed_cloud import PosedCloud
from ..stage_files import write_json
from ..stage_results import REPORT_FILE, LevelMap
from .quick_index import write_quick_index
from .quick_test import quick_test

_log = logging.getLogger(__name__)


@dataclass
class QuickVersion:
    """The provisional version of one build. It is made once, of what is there first.

    Attributes:
        folder: of its files; what is in it is removed.
        threads: run the work.
        publish: takes the folder with the files of the version, and the cloud that they are made of.
        is_tried: whether there were points and poses to make it of.
        is_published: whether it was handed on.
    """

    config: BuildConfig
    folder: Path
    threads: Executor
    publish: Callable[[Path, PosedCloud], None]
    is_tried: bool = field(default=False, init=False)
    is_published: bool = field(default=False, init=False)

    def make(self, cloud: PosedCloud) -> None:
        """Make and publish the version, unless it cannot be made, or its test finds too few places."""
        self.is_tried = True
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir(parents=True)
        try:
            tested = self._made(cloud)
        except BuildFailed as error:
            _log.warning("no provisional version from the poses of the run: %s", error)
            return
        except Exception:  # the full version may not fail for it
            _log.exception("no provisional version from the poses of the run")
            return
        if not tested.queries or tested.found < self.config.activate.min_found:
            _log.warning(
                "no provisional version from the poses of the run: its self-test found %.0f %% of %d places",
                100 * tested.found,
                tested.queries,
            )
            return
        self.publish(self.folder, cloud)
        self.is_published = True

    def _made(self, cloud: PosedCloud) -> SelfTest:
        """Write all files of the version. Returns the results of its self-test."""
        places = write_quick_index(cloud, self.config, self.threads, self.folder)
        localizer = Localizer(MapIndex.load(self.folder, Calibration()), explains=False)
        tested = quick_test(localizer, cloud.held_out.scans, places, self.config, self.threads)
        write_json(self.folder / CALIBRATION_FILE, tested.calibration.to_mapping())
        write_json(self.folder / BOUND_FILE, tested.bound.to_mapping())
        write_json(self.folder / REPORT_FILE, tested.report.to_mapping())
        return tested.report


def posed_cloud_of(read: LevelMap) -> PosedCloud | None:
    """The points and poses of a map that was read before; None: it is a mesh, or has no poses."""
    trajectory = read.trajectory
    if read.is_mesh or trajectory is None:
        return None
    held_out = HeldOut.load(read.directory).moved(inverse(read.T_map_level))
    return PosedCloud(read.points, trajectory, read.spacing_m, read.T_map_level, read.findings, held_out)
