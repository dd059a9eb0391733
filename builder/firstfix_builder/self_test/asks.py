"""The queries of a self-test: what is planned, and each asked of the real localizer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from firstfix.answer.options import LocalizeOptions
from firstfix.builds.config import SelfTestConfig
from firstfix.engine.localizer import Localizer
from firstfix.scan.compact import CompactScan
from firstfix.scan.scan import Scan
from firstfix.sensor import SensorModel
from firstfix.transform import inverse, make_transform

from ..simulation.perturb import ScanCase, ScanSimulation
from ..simulation.simulate import Simulator
from .alias_leads import aliases_among, lead_lost
from .enough import ROUNDS
from .equal_places import equal_places
from .outcome import Outcome
from .real_scans import RealScans
from .strangers import drawn_strangers


@dataclass(frozen=True)
class SimulatedScan:
    """A scan of the map that is taken when it is asked."""

    simulation: ScanSimulation
    case: ScanCase
    is_rough: bool


@dataclass(frozen=True)
class Query:
    """A planned query.

    Attributes:
        number: of the query, which says the fold of its cases.
        of: a scan of the map, or a stranger.
    """

    number: int
    of: SimulatedScan | CompactScan


@dataclass(frozen=True)
class Asked:
    """A query that was asked, with its scan."""

    outcome: Outcome
    scan: Scan | CompactScan


def planned_rounds(
    localizer: Localizer,
    simulator: Simulator,
    sensor: SensorModel,
    config: SelfTestConfig,
    rng: np.random.Generator,
) -> list[list[Query]]:
    """The queries of each of ROUNDS rounds, all kinds of them in each.

    They are drawn as one, so the first rounds ask the same whether others follow or not.
    """
    index = localizer.index
    roughly = round(config.rough * config.queries)
    parts: list[list[SimulatedScan | CompactScan]] = []
    for perturb, count, is_rough in (
        (config.perturb_roughly, roughly, True),
        (config.perturb, config.queries - roughly, False),
    ):
        simulation = ScanSimulation(simulator, sensor, perturb)
        cases = simulation.cases(index.cascade.templates.position_m, index.config.spacing_m, count, rng)
        parts.append([SimulatedScan(simulation, case, is_rough) for case in cases])
    parts.append([*drawn_strangers(config.outside, rng)])
    rounds: list[list[Query]] = [[] for _ in range(ROUNDS)]
    first = 0
    for part in parts:
        order = np.random.default_rng([config.seed, first]).permutation(len(part))
        for number, row in enumerate(order.tolist()):
            rounds[number * ROUNDS // len(part)].append(Query(first + row, part[row]))
        first += len(part)
    return rounds


@dataclass(frozen=True)
class Asks:
    """The asking side of a self-test: the localizer answers scans, and each answer is judged. Thread-safe."""

    localizer: Localizer
    simulator: Simulator
    sensor: SensorModel

    @property
    def options(self) -> LocalizeOptions:
        """Options of all queries but the confirmed ones."""
        return LocalizeOptions(T_base_sensor=make_transform(self.sensor.R_base_sensor, np.zeros(3)))

    def ask(self, query: Query) -> Asked:
        """Take the scan of a query, if it has none yet, and ask it."""
        if isinstance(query.of, CompactScan):
            return Asked(Outcome.nowhere(query.number, self.localizer.localize(query.of)), query.of)
        index, taken = self.localizer.index, query.of
        simulation, case, ranking = taken.simulation, taken.case, index.config.ranking
        clean = simulation.clean_ranges(case)
        scan = simulation.scan(case, clean=clean)
        answer = self.localizer.localize(scan, self.options)
        T_level_map = inverse(index.T_map_level)
        outcome = replace(
            Outcome.here(query.number, answer, case.T_level_sensor, index.T_map_level),
            equals=equal_places(
                answer, self.simulator, self.sensor, case.T_level_sensor, T_level_map, ranking
            ),
            lead_lost=None
            if taken.is_rough
            else lead_lost(self.localizer, simulation, case, clean, scan, self.options),
            aliases=aliases_among(index, answer),
            is_rough=taken.is_rough,
        )
        return Asked(outcome, scan)

    def ask_real(self, real: RealScans, number: int, planned: int) -> Outcome:
        """Ask one of the real scans.

        Args:
            planned: number of the queries that are not real.
        """
        index, one = self.localizer.index, real.scans[number]
        answer = self.localizer.localize(one.scan, real.options_of(number, self.options))
        outcome = Outcome.here(real.query(number, planned), answer, one.T_sensor, index.T_map_level)
        return replace(outcome, aliases=aliases_among(index, answer), is_real=True)


def count_of(rounds: Sequence[Sequence[Query]]) -> int:
    """Number of queries in rounds."""
    return sum(map(len, rounds))
