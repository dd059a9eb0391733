"""Which templates look like the scan, and the pose that each implies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .descriptor import Described
from .map_index import MapIndex
from .options import LocalizeOptions
from .preprocess import PreparedScan
from .transform import Matrix, inverse, make_transform, rotation_z, transform_points

YAW_SLACK_DEG = 10.0  # a candidate's heading is as coarse as the descriptor's sectors


@dataclass(frozen=True)
class Candidate:
    """A template that the search proposes.

    Attributes:
        T_level_sensor: (4, 4) as the template's place and the best turn imply it.
        score: 0..1, of the two descriptors at that turn.
    """

    template: int
    T_level_sensor: Matrix
    score: float


def search(
    index: MapIndex, described: Described, prepared: PreparedScan, options: LocalizeOptions
) -> list[Candidate]:
    """The templates most like the scan that the prior allows, best first; as many as the options say.

    Args:
        described: the one scan.
    """
    config, templates, prior = index.config.search, index.cascade.templates, options.prior
    if prior is None:
        matches = index.cascade.search(described, config.clusters)
    else:
        centre = transform_points(inverse(index.T_map_level), prior.position_m[None])[0]
        away_m = np.linalg.norm(templates.position_m - centre, axis=1)
        near = away_m <= prior.radius_m + index.config.spacing_m
        matches = index.cascade.search_among(described, near, config.clusters)
    candidates: list[Candidate] = []
    for row, yaw, score in zip(matches.rows, matches.yaw_rad, matches.score, strict=True):
        if len(candidates) == (options.max_candidates or config.candidates):
            break
        # the template's floor counts, not its mount: this sensor may sit higher
        position = templates.position_m[row] + [0, 0, prepared.height_m - templates.height_m[row]]
        T_level_sensor = make_transform(rotation_z(yaw) @ prepared.R_level_sensor, position)
        T_map_sensor = index.T_map_level @ T_level_sensor
        if prior is None or prior.allows(T_map_sensor, slack_m=np.inf, slack_deg=YAW_SLACK_DEG):
            candidates.append(Candidate(int(row), T_level_sensor, float(score)))
    return candidates
