"""The choice whether learned keys and calibration are kept: by the share of changed templates."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.engine.config import EngineConfig
from firstfix.engine.retrieval.cascade import Templates

from .base_version import BaseVersion

_log = logging.getLogger(__name__)
MAX_CHANGED = 0.2  # share of the templates, of all changes since keys and calibration were learned
DIFFERS = 0.1  # of the cells that a template had or has: with more in one alone, it has changed
AT_ONCE = 4096
TAUGHT_ANEW = "taught_anew"  # of a self-test's report: the calibration before did not hold


@dataclass(frozen=True)
class ChangedTemplates:
    """The templates that look otherwise than those of the version before, at the same places or at none.

    Attributes:
        row_before: (n,) row that each template now had before; -1: it has changed, or is new.
        gone: of those before, the number that have no place now.
    """

    row_before: NDArray[np.int64]
    gone: int

    @classmethod
    def of(cls, before: Templates, now: Templates) -> ChangedTemplates:
        """Compare templates that are described by layered occupancy."""
        row_before = _rows_at(before, now)
        same = np.flatnonzero(row_before >= 0)
        gone = len(before) - len(same)
        for start in range(0, len(same), AT_ONCE):
            rows = same[start : start + AT_ONCE]
            old, new = before.described_at(row_before[rows])["occupancy"], now.described_at(rows)["occupancy"]
            differing, either = np.bitwise_xor(old, new), np.bitwise_or(old, new)
            row_before[rows[_bits(differing) > DIFFERS * _bits(either)]] = -1
        return cls(row_before, gone)

    @property
    def rows(self) -> NDArray[np.int64]:
        """(k,) rows of the templates that have changed or are new."""
        return np.flatnonzero(self.row_before < 0)

    @property
    def share(self) -> float:
        """Share of the templates that have changed, are new or are gone."""
        return (len(self.rows) + self.gone) / (len(self.row_before) + self.gone)


@dataclass(frozen=True)
class Kept:
    """Learned keys of its base that a build keeps, and the calibration if the self-test does not refute it.

    Attributes:
        changed: against the base.
        since_taught: share of the templates that have changed since the keys were learned, all rebuilds
            together.
    """

    base: BaseVersion
    changed: ChangedTemplates
    since_taught: float

    @classmethod
    def of(cls, base: BaseVersion, engine: EngineConfig, templates: Templates) -> Kept | None:
        """The part that is kept; None: nothing, and the build goes on as one from nothing.

        Args:
            engine, templates: of the build.
        """
        if engine != base.engine:
            _log.info("nothing is kept of the version before: it has other parameters of the engine")
            return None
        changed = ChangedTemplates.of(base.templates, templates)
        since_taught = changed.share + float(base.rebuilt.get("changed_since_taught", 0.0))
        if since_taught > MAX_CHANGED:
            _log.info("nothing is kept of the version before: %.0f %% have changed", 100 * since_taught)
            return None
        return cls(base, changed, since_taught)

    def record(self, *, is_taught_anew: bool) -> dict[str, Any]:
        """The manifest's record: the base, whose keys and calibration these are, and what has changed.

        ``calibration_of`` is None where the self-test has taught a new one.
        """
        before = self.base.rebuilt
        calibration_of = before.get("calibration_of") or self.base.digest
        return {
            "base": self.base.digest,
            "changed": len(self.changed.rows),
            "gone": self.changed.gone,
            "changed_since_taught": round(self.since_taught, 6),
            "keys_of": before.get("keys_of") or self.base.digest,
            "calibration_of": None if is_taught_anew else calibration_of,
        }


def _bits(packed: NDArray[Any]) -> NDArray[np.int64]:
    """(n,) number of the bits that are set in (n, bytes)."""
    return np.unpackbits(packed, axis=1).sum(axis=1, dtype=np.int64)


def _rows_at(before: Templates, now: Templates) -> NDArray[np.int64]:
    """(n,) row of the template before at each of n places and heights, -1 where there is none."""
    there, here = (
        np.ascontiguousarray(np.column_stack([one.position_m, one.height_m]), np.float32).view("V16").ravel()
        for one in (before, now)
    )
    order = np.argsort(there, kind="stable")
    at = np.minimum(np.searchsorted(there[order], here), len(order) - 1)
    return np.where(there[order[at]] == here, order[at], -1)
