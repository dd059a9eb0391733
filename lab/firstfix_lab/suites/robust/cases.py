"""The cases of the suite, one row of the report each: perturbations, sensors, and where scans are taken."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from firstfix.builds.config import PerturbConfig

CLEAN = PerturbConfig(
    noise_m=0, dropout=0, occluders=0, strangers=0, unmapped=0, vanished=0, height_m=0, tilt_deg=0
)
ALL = PerturbConfig(
    noise_m=0.02, dropout=0.1, occluders=6, strangers=0, unmapped=0, vanished=0, height_m=0.05, tilt_deg=2
)
ANY, OTHER = "any", "other"
SENSORS = (
    "vlp-16",
    "hdl-32e",
    "hdl-64e",
    "os0-32",
    "os0-128",
    "os1-32",
    "os1-64",
    "xt16",
    "xt32",
    "qt64",
    "qt128",
    "mid-360",
)
Where = Literal["map", "changed", "own queries", "strange yard", "other worlds", "look-alikes"]


@dataclass(frozen=True)
class Case:
    """One row of the report.

    Attributes:
        where: the scans are taken. In the map as it was, on another day ("changed"), as the world's own
            queries (which have their own perturbations); the rest lies outside the map.
        templates, queries: the sensor presets; None: the world's own. OTHER: one of another kind.
            ANY: many, some scans of each.
        own_height: whether the asking sensor stands as high as its preset does, not as the templates do.
    """

    name: str
    perturb: PerturbConfig
    where: Where = "map"
    templates: str | None = None
    queries: str | None = None
    own_height: bool = False

    @property
    def is_outside(self) -> bool:
        return self.where in ("strange yard", "other worlds", "look-alikes")


def _only(**changes: float) -> PerturbConfig:
    """One thing wrong, all else clean."""
    return CLEAN.model_copy(update=changes)


CASES = (
    Case("clean", CLEAN),
    Case("noise 2 cm", _only(noise_m=0.02)),
    Case("dropout 10 %", _only(dropout=0.1)),
    Case("6 occluders", _only(occluders=6)),
    Case("12 occluders", _only(occluders=12)),
    Case("height 0.1 m", _only(height_m=0.1)),
    Case("tilt 2 deg", _only(tilt_deg=2)),
    Case("tilt 5 deg", _only(tilt_deg=5)),
    Case("all at once", ALL),
    Case("vlp-16 asks", _only(noise_m=0.02), queries="vlp-16"),
    Case("vlp-16 asks, all at once", ALL, queries="vlp-16"),
    Case("mid-360 asks", _only(noise_m=0.02), queries="mid-360"),
    Case("mid-360 asks, all at once", ALL, queries="mid-360"),
    Case("any sensor asks", _only(noise_m=0.02), queries=ANY, own_height=True),
    Case("any sensor asks, all at once", ALL, queries=ANY, own_height=True),
    Case("any sensor on another's templates", ALL, templates=OTHER, queries=ANY, own_height=True),
    Case("changed", _only(noise_m=0.02), "changed"),
    Case("changed, all at once", ALL, "changed"),
    Case("the world's own queries", CLEAN, "own queries"),
    Case("outside: a strange yard", ALL, "strange yard"),
    Case("outside: other worlds", ALL, "other worlds"),
    Case("outside: look-alikes", ALL, "look-alikes"),
)


@dataclass(frozen=True)
class Sizes:
    """Number of scans of a case: with all perturbations, with one, and outside the map."""

    all_at_once: int
    single: int
    outside: int

    def of(self, case: Case) -> int:
        if case.is_outside:
            return self.outside
        return self.all_at_once if case.name == "all at once" else self.single


FULL = Sizes(120, 36, 70)  # some 8,800 scans in all
QUICK = Sizes(20, 20, 20)
