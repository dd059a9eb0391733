"""Hilti SLAM Challenge 2022 (Zhang et al., RA-L 2023): buildings, Hesai PandarXT-32 carried by hand.

exp14_basement_2.bag                       the clouds of /hesai/pandar
exp14_basement_2_imu.txt                   time in seconds, x y z qx qy qz qw of the IMU
"""

from __future__ import annotations

from pathlib import Path

from firstfix.errors import NotFound
from firstfix.transform import from_quaternion

from .bag_clouds import BagClouds, bags_in
from .ground_truth import read_tum
from .recording import Recording

TOPIC = "/hesai/pandar"
T_IMU_SENSOR = from_quaternion([-0.001, -0.00855, 0.055], [0.7071068, -0.7071068, 0.0, 0.0])


def open_hilti(path: Path) -> Recording:
    """Open a bag, or the folder of one, with the ground truth of its name beside it.

    Raises:
        NotFound: it lacks a bag or ground truth.
        MalformedData, TooLarge: the bag or the ground truth is damaged.
    """
    bags = bags_in(path)
    folder = path.parent if path.is_file() else path
    stem = bags[0].stem if len(bags) == 1 else ""
    truths = sorted(folder.glob("*_imu.txt"))
    # Some files of the data set are named exp_04_... beside bags exp04_...
    named = [file for file in truths if _plain(file.stem.removesuffix("_imu")) == _plain(stem)]
    found = named or (truths if len(truths) == 1 and not path.is_file() else [])
    if not found:
        raise NotFound(f"{folder}: no ground truth {stem or '*'}_imu.txt beside the bag")
    return BagClouds(bags, TOPIC, read_tum(found[0]), T_IMU_SENSOR)


def _plain(name: str) -> str:
    return name.replace("_", "").lower()
