"""The table of the data sets."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from firstfix.errors import InvalidOption, NotFound

from .helipr import open_helipr
from .hilti import open_hilti
from .mulran import open_mulran
from .names import Dataset
from .nclt import open_nclt
from .newer_college import open_newer_college
from .recorded import open_recorded
from .recording import Recording

_OPEN: dict[Dataset, Callable[[Path], Recording]] = {
    Dataset.nclt: open_nclt,
    Dataset.mulran: open_mulran,
    Dataset.hilti: open_hilti,
    Dataset.newer_college: open_newer_college,
    Dataset.recording: open_recorded,
}


def open_dataset(dataset: Dataset, path: Path, lidar: str | None = None) -> Recording:
    """Open one recording of a data set, in the folders that its authors ship.

    Args:
        path: folder of the recording.
        lidar: for HeLiPR, which of its LiDARs.

    Raises:
        NotFound: no such folder, or scans or ground truth are missing.
        InvalidOption: ``lidar`` with a data set of one LiDAR, or as ``open_helipr`` says.
        MalformedData, TooLarge: the ground truth or a bag is damaged.
    """
    if not path.exists():
        raise NotFound(f"{path}: no such folder")
    if dataset is Dataset.helipr:
        return open_helipr(path, lidar)
    if lidar is not None:
        raise InvalidOption(f"--lidar is for {Dataset.helipr.value}: {dataset.value} has one LiDAR")
    return _OPEN[dataset](path)
