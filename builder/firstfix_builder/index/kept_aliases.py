"""Known aliases of a map of which little has changed.

Templates that have not changed keep those of the version before, as far as these have not changed either.
Changed ones are searched for. What a changed template looks like gets it as an alias, too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firstfix.engine.config import AliasConfig
from firstfix.engine.retrieval.alias_table import NONE, AliasTable
from firstfix.engine.retrieval.cascade import Cascade

from .find_aliases import enter_aliases, kept_apart


@dataclass(frozen=True)
class KeptAliases:
    """The aliases of the version before.

    Attributes:
        before: of its templates.
        row_before: (n,) row that each template had there; -1: it has changed, or is new.
    """

    before: AliasTable
    row_before: NDArray[np.int64]

    def renewed(self, cascade: Cascade, keys: NDArray[np.float32], config: AliasConfig) -> AliasTable:
        """The aliases of all templates now.

        Args:
            keys: (c, d) of the clusters, as they are searched.
        """
        table = self._moved(config.each)
        changed = np.flatnonzero(self.row_before < 0)
        enter_aliases(cascade, keys, config, table, changed)
        for template in changed.tolist():
            _, rows, yaw_rad, score = table.of(np.array([template]))
            for row, yaw, alike in zip(rows.tolist(), yaw_rad.tolist(), score.tolist(), strict=True):
                if self.row_before[row] >= 0:
                    _enter(table, cascade, row, template, -yaw, alike)
        return table

    def _moved(self, each: int) -> AliasTable:
        """The aliases before, by the rows that templates have now, without those of changed templates."""
        table = AliasTable.none(len(self.row_before), each)
        same = np.flatnonzero(self.row_before >= 0)
        row_now = np.full(len(self.before.row) + 1, NONE, np.int32)  # the last one is that of NONE
        row_now[self.row_before[same]] = same
        there = self.row_before[same]
        row = row_now[self.before.row[there]]
        order = np.argsort(row == NONE, axis=1, kind="stable")
        table.row[same] = np.take_along_axis(row, order, axis=1)
        for name in ("turn", "score"):
            moved = np.take_along_axis(getattr(self.before, name)[there], order, axis=1)
            getattr(table, name)[same] = np.where(table.row[same] == NONE, 0, moved)
        return table


def _enter(
    table: AliasTable, cascade: Cascade, template: int, alias: int, yaw_rad: float, score: float
) -> None:
    """Enter one more alias of a template, if it is among its most similar ones and no spot of them."""
    _, rows, yaws, scores = table.of(np.array([template]))
    rows, yaws, scores = np.append(rows, alias), np.append(yaws, yaw_rad), np.append(scores, score)
    order = np.argsort(-scores, kind="stable")
    rows, yaws, scores = rows[order], yaws[order], scores[order]
    chosen = kept_apart(cascade, template, rows, yaws, table.row.shape[1])
    table.row[template] = NONE
    table.turn[template] = table.score[template] = 0
    table.put(template, rows[chosen], yaws[chosen] % (2 * math.pi), scores[chosen])
