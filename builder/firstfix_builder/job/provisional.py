"""The provisional version of a map: coarse, untested, made in seconds, served until the full one is there."""

from __future__ import annotations

import json
from pathlib import Path

from firstfix.builds.config import BuildConfig, LearnKeysConfig
from firstfix.engine.false_accept_bound import FILE_NAME as BOUND_FILE
from firstfix.engine.false_accept_bound import FalseAcceptBound
from firstfix.engine.index import CALIBRATION_FILE
from firstfix.engine.ranking import Calibration

THINNED_M = 0.2  # between points
COARSER = 1.5  # cells of the surface, against those that follow the points' spacing
BLOCK_CELLS = 128  # edge of a block of the surface: small ones, so that all processors work
MAX_RAYS = 4096  # of a simulated scan
NEAR_TRAJECTORY_M = 4.0


def provisional_config(config: BuildConfig) -> BuildConfig:
    """The config of the provisional version: the same place and sensor, with a fraction of the work.

    Its surface is coarse. Templates stand near the trajectory if there is one. Keys are not learned.
    """
    reconstruct, viewpoints = config.reconstruct, config.viewpoints
    near_m = min(viewpoints.max_distance_to_trajectory_m or NEAR_TRAJECTORY_M, NEAR_TRAJECTORY_M)
    return config.model_copy(
        update={
            "reconstruct": reconstruct.model_copy(
                update={
                    "surface": "signed-distance",
                    "cell_m": None if reconstruct.cell_m is None else COARSER * reconstruct.cell_m,
                    "cell_spacings": COARSER * reconstruct.spacings_per_cell,
                    "tile_cells": min(reconstruct.cells_per_tile, BLOCK_CELLS),
                }
            ),
            "viewpoints": viewpoints.model_copy(update={"max_distance_to_trajectory_m": near_m}),
            "simulate": config.simulate.model_copy(
                update={"max_rays": min(config.simulate.max_rays, MAX_RAYS)}
            ),
            "learn_keys": LearnKeysConfig(scans=0),
        }
    )


def write_prior(directory: Path) -> None:
    """Writes the files that a self-test would: the calibration of no map in particular, and no bound."""
    files = {CALIBRATION_FILE: Calibration().to_mapping(), BOUND_FILE: FalseAcceptBound().to_mapping()}
    for name, content in files.items():
        (directory / name).write_text(json.dumps(content, sort_keys=True, indent=1) + "\n")
