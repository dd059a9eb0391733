"""The self-test of a map of which little has changed: of the changed part, and of a sample of the rest.

The version keeps the calibration of the one before. The scans of the changed part say whether it is found
there, those of the rest whether the calibration still holds: if they find clearly fewer places than the
version before did, or any answer is wrong, they refute it, and the whole self-test is run besides.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.builds.config import SelfTestConfig
from firstfix.engine.calibration import Calibration
from firstfix.engine.false_accept_bound import upper_bound
from firstfix.engine.localizer import Localizer
from firstfix.errors import BuildCancelled
from firstfix.sensor import SensorModel
from firstfix.transform import inverse

from ..simulation.perturb import ScanSimulation
from ..simulation.simulate import Simulator
from .alias_leads import aliases_among
from .asks import Asks, SimulatedScan
from .enough import Ended
from .localizability import QueriedPlace, cells_of, grid_of
from .outcome import Outcome
from .real_scans import RealScans
from .results import SelfTest, part_of, queried_places, results_of_real

SCANS = 24  # of the changed part, and as many of the rest
_SURE = 0.95  # that the calibration does not hold


@dataclass(frozen=True)
class ChangedPartTested:
    """Results of scans in the changed part and in the rest.

    Attributes:
        report: as ``SelfTest.to_mapping``, with ``changed`` and ``unchanged``. Shares found, localized and
            successful are those of the version before for the rest, and those seen for the changed part,
            each by its share of the templates. All else but what was asked is that of the version before.
        places: the scans in the map.
        holds: whether the calibration holds; else the report's figures say nothing but ``parts``.
    """

    report: dict[str, Any]
    places: list[QueriedPlace]
    holds: bool

    @property
    def parts(self) -> dict[str, Any]:
        """The findings in the changed part and in the rest, for a report of the whole self-test, too."""
        return {name: self.report[name] for name in ("changed", "unchanged")}


@dataclass(frozen=True)
class ChangedPart:
    """The changed part of a map, and the self-test of the version before.

    Attributes:
        changed: (k,) rows of the templates that have changed.
        share: of the templates, 0..1.
        before: report of the version before.
        calibration: of the version before.
    """

    changed: NDArray[np.int64]
    share: float
    before: Mapping[str, Any]
    calibration: Calibration

    def test(
        self,
        localizer: Localizer,
        simulator: Simulator,
        sensor: SensorModel,
        config: SelfTestConfig,
        real: RealScans,
        executor: Executor,
        progress: Callable[[float], None],
        cancelled: Callable[[], bool],
    ) -> ChangedPartTested:
        """Ask the scans in the index's levelled frame.

        Raises:
            BuildCancelled: cancelled() said so.
        """
        asks, index = Asks(localizer, simulator, sensor), localizer.index
        positions_m, spacing_m = index.cascade.templates.position_m, index.config.spacing_m
        changed_m, rest_m = positions_m[self.changed], np.delete(positions_m, self.changed, axis=0)
        rng = np.random.default_rng(config.seed)
        changed = list(_scans(simulator, sensor, config, changed_m, spacing_m, rng))
        rest = list(_scans(simulator, sensor, config, rest_m, spacing_m, rng))
        planned, done = len(changed) + len(rest), 0

        def ticked() -> None:
            nonlocal done
            done += 1
            progress(min(1.0, done / (planned + len(real.scans))))
            if cancelled():
                raise BuildCancelled("cancelled during the self-test")

        def run(numbered: tuple[int, SimulatedScan]) -> Outcome:
            number, one = numbered
            answer = localizer.localize(one.simulation.scan(one.case), asks.options)
            outcome = Outcome.here(number, answer, one.case.T_level_sensor, index.T_map_level)
            ticked()
            return self._judged(replace(outcome, is_rough=one.is_rough), localizer)

        def run_real(number: int) -> Outcome:
            outcome = self._judged(asks.ask_real(real, number, planned), localizer)
            ticked()
            return outcome

        outcomes = list(executor.map(run, enumerate([*changed, *rest])))
        of_real = list(executor.map(run_real, range(len(real.scans))))
        here, elsewhere = outcomes[: len(changed)], outcomes[len(changed) :]
        places = queried_places(outcomes, self.calibration, inverse(index.T_map_level))
        grid = self._grid(self.before["localizability"], changed_m, places)
        report = self._report(here, elsewhere, of_real, real, grid)
        is_silent = len(self.changed) > 0 and not changed  # nothing says what is found there
        is_refuted = is_silent or self._is_refuted(elsewhere, [*outcomes, *of_real])
        return ChangedPartTested(report, places, not is_refuted)

    def _judged(self, outcome: Outcome, localizer: Localizer) -> Outcome:
        """The outcome with what the map's index and the calibration say of ties."""
        index = localizer.index
        return replace(
            outcome,
            aliases=aliases_among(index, outcome.answer),
            min_margin=self.calibration.min_margin,
            ranking=index.config.ranking,
        )

    def _is_refuted(self, rest: Sequence[Outcome], every: Sequence[Outcome]) -> bool:
        if any(one.accepted_by(self.calibration) and not one.right for one in every):
            return True
        found = sum(one.found_by(self.calibration) for one in rest)
        return upper_bound(found, len(rest), _SURE) < float(self.before["found"])

    def _report(
        self,
        changed: Sequence[Outcome],
        rest: Sequence[Outcome],
        of_real: Sequence[Outcome],
        real: RealScans,
        grid: list[dict[str, object]],
    ) -> dict[str, Any]:
        calibration, asked = self.calibration, [*changed, *rest]
        told = SelfTest(**{one.name: self.before[one.name] for one in fields(SelfTest)})
        here, there = part_of(changed, calibration), part_of(rest, calibration)
        success = {
            limit: self._mixed(share, here["success"][limit], changed)
            for limit, share in told.success.items()
        }
        tested = replace(
            told,
            queries=len(asked),
            outside=0,
            success=success,
            found=self._mixed(told.found, here["found"], changed),
            localized=self._mixed(told.localized, here["localized"], changed),
            parts={
                "as real": part_of([one for one in asked if not one.is_rough], calibration),
                "roughly": part_of([one for one in asked if one.is_rough], calibration),
            },
            false_accepts=0,
            localizability=grid,
            asked=Ended(len(asked), 1.0, (), is_decided=True).to_mapping(),
        )
        compared = results_of_real(tested, of_real, calibration, real, real.weight(len(asked)))
        return {**replace(tested, real=compared).to_mapping(), "changed": here, "unchanged": there}

    def _mixed(self, before: float, here: float, changed: Sequence[Outcome]) -> float:
        share = self.share if changed else 0.0
        return round((1 - share) * before + share * here, 4)

    def _grid(
        self,
        before: Sequence[Mapping[str, Any]],
        changed_m: NDArray[np.float32],
        places: Sequence[QueriedPlace],
    ) -> list[dict[str, object]]:
        """The cells of both versions; those of the changed part as they are now."""
        now = grid_of(places)
        gone = {str([x, y]) for x, y in cells_of(changed_m)} | {str(one["cell"]) for one in now}
        kept = [dict(one) for one in before if str(list(one["cell"])) not in gone]
        return sorted([*kept, *now], key=lambda one: str(one["cell"]))


def _scans(
    simulator: Simulator,
    sensor: SensorModel,
    config: SelfTestConfig,
    around_m: NDArray[np.float32],
    spacing_m: float,
    rng: np.random.Generator,
) -> Iterator[SimulatedScan]:
    """Up to SCANS scans near (k, 3) templates, some of them rough."""
    count = min(SCANS, config.queries) if len(around_m) else 0
    roughly = round(config.rough * count)
    for perturb, some, is_rough in (
        (config.perturb_roughly, roughly, True),
        (config.perturb, count - roughly, False),
    ):
        simulation = ScanSimulation(simulator, sensor, perturb)
        for case in simulation.cases(around_m, spacing_m, some, rng) if some else ():
            yield SimulatedScan(simulation, case, is_rough)
