"""The arctangent as a fraction of a turn, the same on every machine and in every language.

The arctangents of libraries differ in their last bits between processors. A point on the edge between two
cells would fall into one or the other. This one is float32 arithmetic in a fixed order, and IEEE 754 defines
the rounding of every step: a client in another language gets the same cells
(clients/protocol/on-the-robot.md). The error is below 5e-7 rad.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# atan(t) / (2 pi t) as a polynomial of t squared, minimax fit over 0..1; highest power last
COEFFICIENTS = (
    0.15915492,
    -0.053049516,
    0.03178285,
    -0.022312926,
    0.015779652,
    -0.0094682965,
    0.003860388,
    -0.0007470915,
)
_TINY = np.float32(1e-30)
_BLOCK = 65_536  # points whose intermediate arrays stay in the cache


def atan2_turns(y: NDArray[np.float32], x: NDArray[np.float32]) -> NDArray[np.float32]:
    """(n,) angles of points (x, y) from the x axis in turns, -0.5 to 0.5.

    The angle has the sign of y. The angle of the origin is 0.
    """
    angle = np.empty(len(x), np.float32)
    for start in range(0, len(x), _BLOCK):
        block = slice(start, start + _BLOCK)
        _atan2_turns(np.asarray(y[block], np.float32), np.asarray(x[block], np.float32), angle[block])
    return angle


def _atan2_turns(y: NDArray[np.float32], x: NDArray[np.float32], out: NDArray[np.float32]) -> None:
    across, along = np.abs(y), np.abs(x)
    t = np.minimum(across, along)
    t /= np.maximum(np.maximum(across, along), _TINY)
    square = t * t
    out[:] = np.float32(COEFFICIENTS[-1])
    for coefficient in COEFFICIENTS[-2::-1]:
        out *= square
        out += np.float32(coefficient)
    out *= t  # within the first octant
    # A mask times a number: masked operations are ten times slower.
    np.abs((across > along) * np.float32(0.25) - out, out=out)
    np.abs((x < 0) * np.float32(0.5) - out, out=out)
    np.copysign(out, y, out=out)
