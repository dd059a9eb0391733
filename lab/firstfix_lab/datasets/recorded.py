"""Any recording with the poses of its sensor: a bag, a capture or an .osf file, and a trajectory.

drive.mcap              or the folder of a bag, a .pcap, an .osf: every form that ``localize --bag`` takes
drive.tum               beside it: time in seconds by the sensor's clock, x y z qx qy qz qw of the sensor
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from firstfix.errors import NotFound

from .bag_clouds import BagClouds
from .ground_truth import read_tum
from .recording import Recording


def open_recorded(path: Path) -> Recording:
    """Open a recording with the trajectory of its name beside it.

    Raises:
        NotFound: there is no trajectory, or the recording has no clouds.
        InvalidOption: several topics have clouds.
        MalformedData, TooLarge: the recording or the trajectory is damaged.
    """
    trajectory = path.parent / f"{path.stem if path.is_file() else path.name}.tum"
    if not trajectory.is_file():
        raise NotFound(
            f"{path}: no trajectory {trajectory.name} beside it (stamp x y z qx qy qz qw of the sensor)"
        )
    return BagClouds([path], None, read_tum(trajectory), np.eye(4))
