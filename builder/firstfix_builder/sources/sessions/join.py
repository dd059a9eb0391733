"""Registration of the whole surface of a session with the surface of the placed sessions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firstfix import native
from firstfix.engine.config import RegistrationConfig
from firstfix.engine.registration.align import MapSurface
from firstfix.engine.registration.surface import Surface
from firstfix.transform import Matrix

from ...viewpoints.even_sample import rows_by_place
from .ask_places import moved, translation

POINTS = 60_000  # of the surface that is registered, from all of its places
PLACE_M = 0.5
PAIR_M = 0.3  # distance of two surfaces of one thing, at most,
PAIR_COSINE = 0.8  # and cosine between their normals, at least
_STEPS = ((True, 0.9, 20), (False, 0.5, 30), (False, 0.2, 30))  # coarse grid or not, reach in m, iterations
_HALF_ANGLE = 0.2


@dataclass(frozen=True)
class Overlap:
    """Common part of two surfaces.

    Attributes:
        share: 0..1, of the moved surface's points that have a pair in the other surface.
        residual_m: median distance of the pairs, point to plane.
        paired_m: (m, 3) points of the moved surface that have a pair, in their own frame.
    """

    share: float
    residual_m: float
    paired_m: NDArray[np.float64]


class PlacedSurface:
    """The surface of all placed sessions, for the registration of another one.

    Args:
        surface: in the frame of the first session.
    """

    def __init__(self, surface: Surface) -> None:
        self.grids = MapSurface.of(surface, RegistrationConfig())

    def join(self, surface: Surface, T_first_session: Matrix) -> Matrix:
        """Register the surface of a session, with the whole overlap at once.

        Args:
            T_first_session: (4, 4) with errors below a metre in the overlap.

        Returns:
            (4, 4) the better T_first_session.
        """
        some = _even(surface)
        for coarse, reach_m, iterations in _STEPS:
            grid = self.grids.coarse if coarse else self.grids.fine
            # about the centre of the overlap: there, rotation and translation hardly depend on each other
            paired_m = self.overlap(some, T_first_session, within_m=reach_m).paired_m
            if not len(paired_m):
                return T_first_session
            centre_m = paired_m.mean(axis=0)
            found, *_ = native.align(
                grid.tables,
                (some.points - centre_m).astype(np.float32),
                some.normals,
                some.oriented,
                (T_first_session @ translation(centre_m))[None],
                iterations,
                reach_m,
                _HALF_ANGLE,
                PAIR_M,
            )
            T_first_session = found[0] @ translation(-centre_m)
        return T_first_session

    def overlap(self, surface: Surface, T_first_session: Matrix, within_m: float = PAIR_M) -> Overlap:
        """The part of a session's surface that lies on the placed one, and the distance there."""
        some = _even(surface)
        grid = self.grids.fine
        points = (moved(T_first_session, some.points.astype(np.float64)) - grid.corner).astype(np.float32)
        normals = some.normals @ T_first_session[:3, :3].T.astype(np.float32)
        row = grid.nearest(points)
        behind = grid.other_face[row]
        back = (row >= 0) & (behind >= 0) & (np.einsum("ij,ij->i", grid.planes[row, :3], normals) < 0)
        row = np.where(back & some.oriented, behind, row)  # the face of the wall that is seen
        planes = grid.planes[row]
        away_m = np.abs(np.einsum("ij,ij->i", planes[:, :3], points) - planes[:, 3])
        facing = np.abs(np.einsum("ij,ij->i", planes[:, :3], normals)) >= PAIR_COSINE
        paired = (row >= 0) & facing & (away_m <= within_m)
        residual_m = float(np.median(away_m[paired])) if paired.any() else float("inf")
        return Overlap(float(paired.mean()), residual_m, some.points[paired].astype(np.float64))


def _even(surface: Surface) -> Surface:
    return surface.at(rows_by_place(surface.points, POINTS, PLACE_M))
