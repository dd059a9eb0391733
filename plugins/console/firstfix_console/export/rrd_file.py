"""A recording for the rerun viewer."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from firstfix.answer.localization import Verdict
from firstfix.errors import pip_install
from firstfix.transform import Matrix, quaternion_of

from .exported_query import GUESS_FRAME, MAP_FRAME, SENSOR_FRAME, UNPLACED_FRAME, ExportedQuery
from .map_cloud import MapCloud

TIMELINE = "time"
NEEDS_RERUN = (
    f"an .rrd file needs rerun: {pip_install('./plugins/console[rerun]')}. rerun opens the .mcap file, too"
)
_LEVELS = {Verdict.LOCALIZED: "INFO", Verdict.AMBIGUOUS: "WARN", Verdict.REJECTED: "WARN"}
_AXES_M = 1.0
_PLACES = {
    SENSOR_FRAME: f"{MAP_FRAME}/{SENSOR_FRAME}",
    GUESS_FRAME: f"{MAP_FRAME}/{GUESS_FRAME}",
    UNPLACED_FRAME: UNPLACED_FRAME,  # beside the map, not in it
}


class RrdFile:
    """Writes entities as they come; the queries may come in any order of time."""

    def __init__(self, rerun: Any, recording: Any) -> None:
        self._rerun, self._recording = rerun, recording

    def write_map(self, cloud: MapCloud, time_ns: int) -> None:
        """Write the map's points, the templates and the mapping run, for all times."""
        rr = self._rerun
        grey = None if cloud.brightness is None else np.repeat(cloud.brightness[:, None], 3, axis=1)
        self._log(f"{MAP_FRAME}/cloud", rr.Points3D(cloud.points, radii=0.02, colors=grey), static=True)
        intensity = cloud.intensity()
        if (
            intensity is not None
        ):  # rerun's points have none of their own: the viewer shows it of a chosen one
            self._log(f"{MAP_FRAME}/cloud", rr.AnyValues(intensity=intensity), static=True)
        self._log(f"{MAP_FRAME}/templates", rr.Points3D(cloud.templates, radii=0.1), static=True)
        self._log(f"{MAP_FRAME}/trajectory", rr.LineStrips3D([cloud.trajectory]), static=True)

    def write_query(self, query: ExportedQuery) -> None:
        """Write one query with its answer. What it does not have is cleared, so that no older one stays."""
        rr = self._rerun
        self._recording.set_time(TIMELINE, timestamp=np.datetime64(query.time_ns, "ns"))
        for frame, place in _PLACES.items():
            if frame != query.frame:
                self._log(place, rr.Clear(recursive=True))
                continue
            if query.T_map_frame is not None:
                self._log(place, self._transform(query.T_map_frame))
            self._log(f"{place}/scan", rr.Points3D(query.points, radii=0.03))
        at = np.array([T[:3, 3] for T in query.hypotheses]).reshape(-1, 3)
        ahead = np.array([T[:3, 0] for T in query.hypotheses]).reshape(-1, 3) * _AXES_M
        self._log(f"{MAP_FRAME}/hypotheses", rr.Arrows3D(vectors=ahead, origins=at))
        truth = f"{MAP_FRAME}/truth"
        if query.T_map_truth is None:
            self._log(truth, rr.Clear(recursive=True))
        else:
            self._log(truth, self._transform(query.T_map_truth))
        self._log("probability", rr.Scalars(query.answer.probability))
        self._log("log", rr.TextLog(query.words, level=_LEVELS[query.answer.verdict]))

    def _transform(self, T: Matrix) -> Any:
        return self._rerun.Transform3D(translation=T[:3, 3], quaternion=quaternion_of(T))

    def _log(self, place: str, what: Any, *, static: bool = False) -> None:
        self._recording.log(place, what, static=static)


@contextmanager
def rrd_file(folder: Path, name: str) -> Iterator[RrdFile]:
    """Give a recording to write to, which is ``folder / "out"`` at the end.

    Args:
        name: of the recording's application, shown by the viewer.

    Raises:
        ModuleNotFoundError: rerun-sdk is not installed.
    """
    try:
        import rerun
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(NEEDS_RERUN, name=error.name) from None

    recording = rerun.RecordingStream(name)
    recording.save(folder / "out")
    yield RrdFile(rerun, recording)
    recording.flush()
    recording.disconnect()
