"""The pieces of the default, each replaced or left out while all others stay."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from firstfix.bit_exact.sample import rows_by_chance
from firstfix.descriptor import Descriptor
from firstfix.engine.localizer import Localizer
from firstfix.scan.scan import Scan
from firstfix.sensor import SensorModel, preset
from firstfix.transform import Matrix
from firstfix_builder.index.learn_keys import discriminants

from ..robust.cases import ALL
from ..robust.outcome import ask
from .described_world import UPRIGHT, Asked, DescribedWorld, Descriptors, Gravity, Known
from .maximum_height import MaximumHeight
from .projections import whitening
from .range_images import reranked
from .trial import LEARNED, LEARNED_AS, SPECTRUM, Row, Trial, row_of

SEED, LEARN_SEED = 9, 10
DEFAULT = "default"
SPACINGS_M = (0.5, 1.0, 2.0)
TILT_DEG = 5.0
TEMPLATE_TILT_DEG = 3.0
TILTED = (
    *UPRIGHT,
    *((side * TEMPLATE_TILT_DEG, 0.0) for side in (-1, 1)),
    *((0.0, side * TEMPLATE_TILT_DEG) for side in (-1, 1)),
)
NUMBERS_TRIED = (32, 64, 256)
SHRINKAGES = (0.1, 0.3, 0.5, 0.9)
REGISTERED_M = 0.2


@dataclass(frozen=True)
class Sizes:
    """Numbers of scans.

    Attributes:
        queries: of every row.
        taught: scans that a projection is learned from.
        registered: queries that go through the whole localizer, for every spacing.
        nearest: templates by key that are compared.
    """

    queries: int = 150
    taught: int = LEARNED_AS.scans
    registered: int = 60
    nearest: int = 400


@dataclass(frozen=True)
class Pieces:
    """Every method is one piece of the table, as rows for one world.

    Attributes:
        localizer: of a version of the world with the given spacing of its templates.
    """

    world: DescribedWorld
    sensor: SensorModel
    localizer: Callable[[float], tuple[Localizer, DescribedWorld]]
    sizes: Sizes

    @cached_property
    def scans(self) -> list[tuple[Scan, Matrix]]:
        return self.world.scans(self.sensor, ALL, self.sizes.queries, (SEED,))

    @cached_property
    def trial(self) -> Trial:
        """The default."""
        return self._of_version(self.world.spacing_m)[0]

    def keys(self) -> list[Row]:
        """Varies the number of Fourier coefficients and the projection of the key."""
        trial, rows = self.trial, self.trial.rows("default", "")
        for coefficients in (1, 4, 16):
            rows += trial.with_coefficients(coefficients).rows(
                "coefficients", f"{coefficients} in place of 8"
            )
        keys, within = trial.template_keys(), trial.within()
        numbers_kept, shrinkage_kept = LEARNED_AS.numbers, LEARNED_AS.shrinkage
        for numbers in NUMBERS_TRIED:
            found = trial.by(discriminants(keys, within, numbers, shrinkage_kept))
            rows.append(row_of("projection", f"{numbers} numbers in place of {numbers_kept}", LEARNED, found))
        for shrinkage in SHRINKAGES:
            found = trial.by(discriminants(keys, within, numbers_kept, shrinkage))
            rows.append(
                row_of("projection", f"shrinkage {shrinkage} in place of {shrinkage_kept}", LEARNED, found)
            )
        for share in (5, 2):
            some = within[rows_by_chance(len(within), len(within) // share)]
            found = trial.by(discriminants(keys, some, numbers_kept, shrinkage_kept))
            rows.append(row_of("projection", f"learned from {len(some)} scans", LEARNED, found))
        found = trial.by(whitening(keys, numbers_kept))
        rows.append(row_of("projection", "whitened only, nothing learned", LEARNED, found))
        return rows

    def cells(self) -> list[Row]:
        """Layers, rings and sectors."""
        how = self._other_cells()
        known = self.world.known(self.sensor, how)
        taught = self.world.asked(self._lessons(self.sensor), how)
        asked = self.world.asked(self.scans, how)
        rows = []
        for name, descriptor in how.items():
            trial = Trial(
                descriptor, known[name], taught[name], asked[name], self.world.spacing_m, self.sizes.nearest
            )
            rows += trial.rows("cells", f"{name} in place of {_of_default(name)}")
        return rows

    def gravity(self) -> list[Row]:
        """Varies the source of the up direction, for scans with the usual tilt and with more."""
        how = {DEFAULT: self.world.descriptor.make()}
        upright, tilted = self.trial.known, self.world.known(self.sensor, how, TILTED)[DEFAULT]
        lessons = self._lessons(self.sensor)
        scans = {ALL.tilt_deg: self.scans, TILT_DEG: self._tilted(TILT_DEG)}
        ways: tuple[tuple[str, Gravity, bool], ...] = (
            ("estimated", "estimated", False),
            ("given", "given", False),
            ("none", "none", False),
            ("none, tilted templates too", "none", True),
        )
        rows = []
        for name, gravity, with_tilted in ways:
            taught = self.world.asked(lessons, how, gravity)[DEFAULT]
            known = tilted if with_tilted else upright
            projection = replace(self.trial, known=known, taught=taught).learned()
            for tilt_deg, those in scans.items():
                asked = self.world.asked(those, how, gravity)[DEFAULT]
                found = replace(self.trial, known=known, asked=asked).by(projection)
                rows.append(row_of("gravity", f"{name}; scans tilted {tilt_deg:g} deg", LEARNED, found))
        return rows

    def spacing(self) -> list[Row]:
        """The same scans asked of coarser and finer templates, and what registration makes of it."""
        rows = []
        for spacing_m in SPACINGS_M:
            trial, localizer = self._of_version(spacing_m)
            projection = localizer.index.cascade.projection
            projection = trial.learned() if projection is None else projection
            outcomes = [ask(localizer, *case, "", "") for case in self.scans[: self.sizes.registered]]
            registered = {
                "registered": round(float(np.mean([o.is_within(REGISTERED_M) for o in outcomes])), 3),
                "localize_ms": round(float(np.median([o.ms for o in outcomes])), 0),
            }
            name = f"{spacing_m:g} m"
            rows.append(row_of("spacing", name, SPECTRUM, trial.by(None)))
            rows.append(row_of("spacing", name, LEARNED, trial.by(projection)) | registered)
        return rows

    def _of_version(self, spacing_m: float) -> tuple[Trial, Localizer]:
        """The version with this spacing, asked the usual scans."""
        localizer, world = self.localizer(spacing_m)
        described = localizer.index.cascade.templates.described
        how = {DEFAULT: self.world.descriptor.make()}
        lessons = world.scans(
            self.sensor.coarser(_LESSON_RAYS), LEARNED_AS.perturb, self.sizes.taught, (LEARN_SEED,)
        )
        trial = Trial(
            how[DEFAULT],
            Known(world.position_m, described, len(world.position_m)),
            world.asked(lessons, how)[DEFAULT],
            self.world.asked(self.scans, how)[DEFAULT],
            spacing_m,
            self.sizes.nearest,
        )
        return trial, localizer

    def reranking(self) -> list[Row]:
        """The best of the comparison sorted again by the range image that each would have."""
        trial = self.trial
        scans = [self.scans[number] for number in trial.asked.number]
        rows = []
        for key, projection in ((SPECTRUM, None), (LEARNED, trial.learned())):
            for name, figures in reranked(self.world, scans, trial.by(projection).found).items():
                rows.append({"piece": "range image", "choice": name, "key": key, **figures})
        return rows

    def sensors(self) -> list[Row]:
        """Scanners that the templates were not made for."""
        how = {DEFAULT: self.world.descriptor.make()}
        rows = []
        for name in ("vlp-16", "mid-360"):
            other = preset(name)
            scans = self.world.scans(other, ALL, self.sizes.queries, (SEED, 1))
            asked = self.world.asked(scans, how)[DEFAULT]
            ours = replace(self.trial, asked=asked)
            theirs = replace(
                ours,
                known=self.world.known(other, how)[DEFAULT],
                taught=self._taught(other, how),
            )
            rows += ours.rows("sensor", f"{name} asks templates of {self.sensor.name}")
            rows += theirs.rows("sensor", f"{name} asks its own templates")
        return rows

    def _other_cells(self) -> dict[str, Descriptor]:
        """The default with one thing of it changed, each."""
        default = self.world.descriptor

        def changed(**changes: object) -> Descriptor:
            return default.model_copy(update=changes).make()

        return {
            "1 layer": changed(layer_edges_m=(0.3, 25.0)),
            "3 layers": changed(layer_edges_m=(0.3, 1.0, 3.0, 25.0)),
            "9 layers": changed(layer_edges_m=(0.3, 0.65, 1.0, 1.4, 1.8, 2.4, 3.0, 4.5, 6.0, 25.0)),
            "maximum height": MaximumHeight(default.grid, default.coefficients),
            "40 rings": changed(rings=40),
            "120 sectors": changed(sectors=120),
        }

    def _lessons(self, sensor: SensorModel) -> list[tuple[Scan, Matrix]]:
        return self.world.scans(
            sensor.coarser(_LESSON_RAYS), LEARNED_AS.perturb, self.sizes.taught, (LEARN_SEED,)
        )

    def _taught(self, sensor: SensorModel, how: Descriptors) -> Asked:
        return self.world.asked(self._lessons(sensor), how)[DEFAULT]

    def _tilted(self, tilt_deg: float) -> Sequence[tuple[Scan, Matrix]]:
        perturb = ALL.model_copy(update={"tilt_deg": tilt_deg})
        return self.world.scans(self.sensor, perturb, self.sizes.queries, (SEED,))


_LESSON_RAYS = 16_384


def _of_default(name: str) -> str:
    return {"rings": "20", "sectors": "60"}.get(name.split()[-1], "5 layers")
