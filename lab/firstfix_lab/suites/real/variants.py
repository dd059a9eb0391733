"""The ways in which a held-out scan is asked."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from firstfix.builds.config import BuildConfig
from firstfix.decode import decode_query
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import AnyScan
from firstfix.sensor import SensorModel
from firstfix.transform import Matrix
from firstfix_client.steps.scan_body import BodyForm, Encoding, encoded
from tests.recorded_data import Dataset

from ...evaluation.outcome import random_yaws, turned
from .degrade import every_second_ring, part_of_points, tilted, without_sectors

SEED = 1  # of the yaw that each scan is turned by, and of what degrades it
LOST = 0.3  # of the points, in sectors
TILT_DEG = 5.0
ENCODINGS: tuple[Encoding, ...] = ("range_image", "compact")  # as robots send it


def variants(dataset: Dataset, scan: Scan, number: int) -> Iterator[tuple[str, AnyScan, Matrix]]:
    """Yield the scan as it is and as robots send it; then degraded in each way, turned by a random yaw.

    Args:
        number: of the scan; it decides on everything random.

    Yields:
        The variant's name, the scan, and the (4, 4) transform from its sensor frame to that of the scan as it
        is.
    """
    rng = np.random.default_rng([SEED, number])
    as_it_is = np.eye(4)
    sensor = BuildConfig.parse(dataset.config).sensor_model
    degraded = (
        ("turned", scan, as_it_is),
        (*_sparse(dataset, scan, sensor, rng), as_it_is),
        (f"{100 * LOST:g} % lost in sectors", without_sectors(scan, LOST, rng), as_it_is),
        (f"rolled and pitched by {TILT_DEG:g} deg", *tilted(scan, as_it_is, TILT_DEG, rng)),
    )
    yield "as it is", scan, as_it_is
    for encoding in ENCODINGS:
        media_type, body = encoded(scan, BodyForm(encoding))
        yield f"sent as {encoding}", decode_query(body, media_type), as_it_is
    for (name, worse, T), yaw in zip(degraded, random_yaws(len(degraded), SEED + number), strict=True):
        turned_scan, T_scan_sensor = turned(worse, T, float(yaw))
        assert T_scan_sensor is not None
        yield name, turned_scan, T_scan_sensor


def _sparse(dataset: Dataset, scan: Scan, sensor: SensorModel, rng: np.random.Generator) -> tuple[str, Scan]:
    if dataset.kept_share is None:
        return "every second ring", every_second_ring(scan, sensor)
    return f"{100 * dataset.kept_share:g} % of the points", part_of_points(scan, dataset.kept_share, rng)
