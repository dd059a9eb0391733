"""Which column of a file of poses is which, by the line that names them.

Files of poses have many orders: the quaternion's w stands first or last, times take one column or two, and
a number of the pose follows. Who names the columns is taken at their word.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .rigid import rigid_from_quaternions, rigid_matrices

_QUATERNION = {"q", "quat", "quaternion", "orientation", "rotation"}
_POSITION = {"p", "t", "pos", "position", "translation", "location", "pose"}
_MATRIX = tuple(f"pose{row}{column}" for row in range(3) for column in range(4))  # HDMapping's names
_UNIT = re.compile(r"[\[(][^\[\]()]*[\])]")  # one look at each character, as lines may be long
_BEFORE_NAMES = re.compile(r"^[A-Za-z ]+:\s")  # "format: "
_VECTORS = ("x", "y", "z", "qx", "qy", "qz", "qw")


@dataclass(frozen=True)
class PoseColumns:
    """Columns of a row that make a pose.

    Attributes:
        places: of x y z qx qy qz qw, or of the 12 numbers of a 3x4 matrix by rows.
        number: column of the pose's number: a negative one is no pose, but a landmark (RTAB-Map); None: there
            is none.
        width: how many columns are named.
    """

    places: tuple[int, ...]
    number: int | None
    width: int

    def is_landmark(self, words: Sequence[str]) -> bool:
        """Whether a row is a landmark. Where the numbers are names, it is none."""
        if self.number is None or self.number >= len(words):
            return False
        try:
            return float(words[self.number]) < 0
        except ValueError:
            return False

    def poses(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """(m, width) rows to (m, 4, 4), without landmarks. Raises MalformedData on a row that is no pose."""
        if self.number is not None:
            rows = rows[rows[:, self.number] >= 0]
        return poses_of(rows[:, self.places])


def poses_of(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """(m, 7) rows of x y z qx qy qz qw, or (m, 12) of a 3x4 matrix, to (m, 4, 4)."""
    if not len(rows):
        return np.empty((0, 4, 4))
    if rows.shape[1] == len(_MATRIX):
        return rigid_matrices(rows.reshape(-1, 3, 4))
    return rigid_from_quaternions(rows[:, :3], rows[:, 3:])


def columns_of(names: str, delimiter: str | None) -> PoseColumns | None:
    """Columns by the line that names them; None: it does not name a pose."""
    names = _BEFORE_NAMES.sub("", names)
    words = [word.strip().strip('"').lower() for word in names.split(delimiter)]
    words = [_UNIT.sub("", word).strip() for word in words]
    words = [word for word in words if word or delimiter is not None]
    known: dict[str, int] = {}
    for place, word in enumerate(words):
        known.setdefault(_meaning(word), place)
    wanted = next((some for some in (_VECTORS, _MATRIX) if set(some) <= set(known)), None)
    if wanted is None:
        return None
    return PoseColumns(tuple(known[name] for name in wanted), known.get("id"), len(words))


def _meaning(name: str) -> str:
    """Name in ``_VECTORS`` that a column's name stands for; of any other the name itself.

    ``p_RS_R_x`` and ``pose.position.x`` are x, ``q_RS_w`` and ``orientation.w`` are qw, and ``v_RS_R_x`` is a
    velocity.
    """
    parts = [part for part in re.split(r"[^a-z0-9]+", name) if part]
    if not parts:
        return ""
    *before, last = parts
    if not before:
        return last[1:] if re.fullmatch(r"[tp][xyz]", last) else last
    if last not in ("x", "y", "z", "w"):
        return name
    if _QUATERNION & set(before):
        return f"q{last}"
    return last if before[0] in _POSITION or "position" in before else name
