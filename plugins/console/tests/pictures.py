"""Measures pictures: shares of colours, and where a place of the map lies in them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from plugins.console.tests.page import Picture

AGREES, CONTRADICTS, UNEXPLAINED = (51, 199, 89), (255, 59, 48), (255, 204, 0)
LOCALIZED = (52, 168, 83)  # the mark of a pose
HINT = (77, 182, 224)  # the way to the next scan
PLOT_LOCALIZED = (52, 168, 83)  # the line of those queries
GONE = (255, 59, 48)  # cells whose mapped surfaces have left
ADDED = (52, 199, 89)  # points that a patch added
GROUND = (16, 22, 27)  # of the 3D picture
_HALF_ANGLE_DEG = 27.5  # of the view from top to bottom


def pixels_of(picture: Picture, colour: Sequence[int], within: int = 12) -> int:
    """Number of pixels of about that colour."""
    away = np.abs(picture.astype(int) - np.array(colour))
    return int((away.max(axis=2) <= within).sum())


def drawn_pixels(picture: Picture) -> int:
    """Number of pixels that are not the empty ground."""
    return picture.shape[0] * picture.shape[1] - pixels_of(picture, GROUND, 3)


def difference(a: Picture, b: Picture) -> float:
    """Share of the pixels that differ clearly."""
    return float((np.abs(a.astype(int) - b).max(axis=2) > 24).mean())


def reddened(before: Picture, after: Picture) -> NDArray[np.bool_]:
    """(h, w) Pixels over which something red was laid."""
    gain = after.astype(int) - before
    return np.asarray((gain[..., 0] > 60) & (gain[..., 0] > 3 * np.abs(gain[..., 1:]).max(axis=2)))


def view_of(target: Sequence[float], eye: Sequence[float]) -> str:
    """The view as a link to the map says it."""
    return ",".join(f"{value:g}" for value in (*target, *eye))


def place_in(
    position: Sequence[float], target: Sequence[float], eye: Sequence[float], width: float, height: float
) -> tuple[float, float]:
    """Pixel at which a position of the map is seen."""
    ahead = np.subtract(target, eye) / np.linalg.norm(np.subtract(target, eye))
    right = np.cross(ahead, [0, 0, 1])
    right /= np.linalg.norm(right)
    away = np.subtract(position, eye)
    scale = height / 2 / math.tan(math.radians(_HALF_ANGLE_DEG)) / (away @ ahead)
    return width / 2 + scale * (away @ right), height / 2 - scale * (away @ np.cross(right, ahead))
