"""One way to describe, in one place: its templates, the scans it learns from, and those it is asked."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.builds.config import LearnKeysConfig
from firstfix.descriptor import Descriptor, rows_of
from firstfix_builder.index.learn_keys import discriminants

from .described_world import Asked, Known
from .recall import Recall, keys_of, recall_of

LEARNED_AS = LearnKeysConfig()
SPECTRUM, LEARNED = "as it is", "projected"
Row = dict[str, Any]


@dataclass(frozen=True)
class Trial:
    """One way to describe scans in one world.

    Attributes:
        taught: scans at other spots than the asked ones, perturbed by the builder's own measure.
        nearest: by key, that are compared.
    """

    descriptor: Descriptor
    known: Known
    taught: Asked
    asked: Asked
    spacing_m: float
    nearest: int

    def by(self, projection: NDArray[np.float32] | None) -> Recall:
        return recall_of(
            self.descriptor, self.known, self.asked, projection, self.spacing_m, nearest=self.nearest
        )

    def template_keys(self) -> NDArray[np.float32]:
        """Keys of the upright templates."""
        return keys_of(self.descriptor, rows_of(self.known.described, slice(0, self.known.upright)))

    def within(self) -> NDArray[np.float32]:
        """(m, d): what the perturbations and the way to the nearest template add to a key."""
        nearest = cKDTree(self.known.position_m[: self.known.upright]).query(self.taught.position_m)[1]
        own: NDArray[np.float32] = self.template_keys()[nearest]
        return keys_of(self.descriptor, self.taught.described) - own

    def learned(self) -> NDArray[np.float32]:
        """The projection as a build learns it."""
        numbers, shrinkage = LEARNED_AS.numbers, LEARNED_AS.shrinkage
        return discriminants(self.template_keys(), self.within(), numbers, shrinkage)

    def with_coefficients(self, coefficients: int) -> Trial:
        return replace(self, descriptor=replace(self.descriptor, coefficients=coefficients))  # type: ignore[type-var]

    def rows(self, piece: str, choice: str) -> list[Row]:
        """With the key as it is, and projected."""
        return [
            row_of(piece, choice, SPECTRUM, self.by(None)),
            row_of(piece, choice, LEARNED, self.by(self.learned())),
        ]


def row_of(piece: str, choice: str, key: str, recall: Recall) -> Row:
    figures = {name: value for name, value in vars(recall).items() if name != "found"}
    return {"piece": piece, "choice": choice, "key": key, **figures}
