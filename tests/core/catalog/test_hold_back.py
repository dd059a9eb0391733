"""Findings of a version, and which versions are published without being activated."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from firstfix.builds.config import ActivateConfig
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import Manifest
from firstfix.catalog.version_findings import findings_of
from firstfix.findings.finding import Severity
from firstfix.findings.map_kinds import MAP_DOUBLED_WALLS, MAP_NOT_LEVEL, PAGE
from firstfix.findings.registry import KINDS
from firstfix.store.store import Store

BY_DEFAULT = ActivateConfig()
MAP_DOUBLED_WALLS_FOUND = MAP_DOUBLED_WALLS.found({"doubled_share": 0.2, "apart_m": 0.4}, near="(1, 2)")


class Maker:
    """Publishes versions as a build does."""

    def __init__(self, folder: Path) -> None:
        self.catalog = Catalog(Store.open(str(folder / "store")))
        self.folder = folder

    def manifest(self, found: float | None, label: str = "", **made: Any) -> Manifest:
        directory = self.folder / f"{found}{label}"
        directory.mkdir(exist_ok=True)
        (directory / "index.bin").write_bytes(f"{found} {label}".encode())
        tested = {} if found is None else {"queries": 120, "found": found, "success": {"1m": found - 0.1}}
        return Manifest.for_directory(directory, **{"self_test": tested, **made})

    def build(self, found: float | None, activate: ActivateConfig = BY_DEFAULT, **made: Any) -> str | None:
        """Returns the code of the finding because of which the version was not activated."""
        manifest = self.manifest(found, **made)
        held = self.catalog.reason_to_hold("hall", manifest, activate)
        directory = self.folder / f"{found}"
        self.catalog.publish("hall", directory, manifest, activate=held is None, build_id="b")
        assert manifest.digest in self.catalog.state("hall").published or manifest.provisional
        return None if held is None else held.code

    @property
    def active(self) -> str | None:
        return self.catalog.active_version("hall")


@pytest.fixture
def maker(tmp_path: Path) -> Maker:
    return Maker(tmp_path)


ANY = ActivateConfig(min_found=0.0)


@pytest.mark.parametrize(
    "builds",
    [
        [(0.9, BY_DEFAULT, None), (0.69, BY_DEFAULT, "self_test_low")],
        [(0.95, BY_DEFAULT, None), (0.86, BY_DEFAULT, None), (0.75, BY_DEFAULT, "self_test_worse")],
        [(0.86, BY_DEFAULT, None), (0.75, ActivateConfig(max_loss=1.0), None)],
        [(0.2, ANY, None), (None, BY_DEFAULT, None)],  # the second one's config wanted no self-test
        [(0.3, ANY, None), (0.3, BY_DEFAULT, None)],  # the active one, built again
    ],
)
def test_a_bad_or_worse_version_is_published_and_not_activated(maker: Maker, builds: list[Any]):
    for found, activate, held in builds:
        before = maker.active
        assert maker.build(found, activate) == held
        assert (maker.active == before) == (held is not None or before == maker.manifest(found).digest)
    assert len(maker.catalog.versions("hall")) == len({found for found, *_ in builds})


@pytest.mark.parametrize(("found", "code"), [(0.69, "self_test_changed_low"), (0.7, None), (None, None)])
def test_a_changed_part_that_is_not_found_holds_a_good_map_back(
    maker: Maker, found: float | None, code: str | None
):
    part = {"queries": 0 if found is None else 24, "found": found or 0.0}
    tested = {"queries": 48, "found": 0.98, "success": {"1m": 0.9}, "changed": part}
    held = maker.catalog.reason_to_hold("hall", maker.manifest(0.98, self_test=tested), BY_DEFAULT)
    assert (None if held is None else held.code) == code


def test_a_first_map_that_fails_serves_nothing_not_even_provisionally(maker: Maker):
    assert maker.build(None, provisional=True) is None
    assert maker.active is not None
    assert maker.build(0.2) == "self_test_low"
    assert maker.active is None
    assert len(maker.catalog.versions("hall")) == 1, "the provisional version is retired"


def test_a_full_version_is_not_measured_by_the_few_scans_of_a_provisional_one(maker: Maker):
    assert maker.build(1.0, provisional=True) is None
    assert maker.build(0.8) is None, "the provisional one was asked between its own templates alone"
    assert maker.build(0.69) == "self_test_low"


@pytest.mark.parametrize("provisional", [False, True])
def test_a_finding_of_a_holding_kind_holds_every_version_back(maker: Maker, provisional: bool):
    findings = [MAP_DOUBLED_WALLS_FOUND, MAP_NOT_LEVEL.found({"level_y_share": 0.4, "level_z_share": 0.1})]
    source = {"findings": [one.to_mapping() for one in findings]}
    held = maker.catalog.reason_to_hold(
        "hall", maker.manifest(0.99, source=source, provisional=provisional), BY_DEFAULT
    )
    assert held is not None
    assert held.code == "map_held_back"
    assert "found map_not_level:" in held.text
    assert "firstfix maps activate hall " in held.remedy
    warned = {"findings": [MAP_DOUBLED_WALLS_FOUND.to_mapping(), {**findings[0].to_mapping(), "code": "new"}]}
    assert maker.build(0.99, source=warned) is None, "a warning alone, or a finding of a later release"


def test_errors_of_maps_and_warnings_that_are_sure_hold_back():
    held = {code for code, kind in KINDS.items() if kind.holds_back}
    errors = {code for code, kind in KINDS.items() if kind.severity is Severity.ERROR and kind.doc == PAGE}
    assert held == errors | {"map_not_level", "trajectory_turned", "trajectory_of_base", "trajectory_leans"}


def test_a_self_test_without_its_queries_holds_back(maker: Maker):
    asked_nothing = {"queries": 0, "found": 0.0, "success": {"1m": 0.0}}
    wanted = {"self_test": {"queries": 120}}
    assert maker.build(0.0, self_test=asked_nothing, config=wanted) == "self_test_none"
    assert maker.build(None, config={"self_test": {"queries": 0}}) is None
    assert maker.build(None, config=wanted, provisional=True) is None


@pytest.mark.parametrize(
    ("found", "asked", "is_held"),
    [(0, 0, False), (0, 1, False)]  # one wrong scan is no evidence
    + [(0, 2, True), (1, 3, False), (0, 3, True), (2, 5, False), (1, 5, True), (6, 10, False), (5, 10, True)]
    + [(27, 40, True), (28, 40, False)],
)
def test_real_scans_hold_back_if_too_few_are_found_by_more_than_chance(maker, found, asked, is_held):
    tested = {"queries": 120, "found": 0.95, "real": {"of_source": {"asked": asked, "found": found}}}
    assert maker.build(0.95, self_test=tested) == ("self_test_real_low" if is_held else None)
    any_real = ActivateConfig(min_real_found=0.0)
    assert maker.build(0.95, any_real, self_test={**tested, "found": 0.96}) is None


def test_a_person_may_activate_a_version_held_back(maker: Maker):
    maker.build(0.2)
    (version,) = maker.catalog.versions("hall")
    maker.catalog.activate("hall", version.version)
    assert maker.active == version.version


COMPARED = {"places": 40, "localized_before": 36, "localized_after": 36}
COMPARED |= dict.fromkeys(("lost", "won", "wrong_before", "wrong_after"), 0)
PATCH = {"queries": 9, "robots": 2, "areas": [], "added_points": 1, "removed_points": 0, "compared": COMPARED}


@pytest.mark.parametrize(
    ("told", "mode", "held"),
    [
        ({}, "activate", None),
        ({}, "propose", "patch_proposed"),
        ({"localized_after": 33, "lost": 4, "won": 1}, "activate", None),
        ({"localized_after": 31, "lost": 5, "won": 0}, "activate", "patch_worse"),
        ({"localized_after": 31, "lost": 5, "won": 0}, "propose", "patch_worse"),
        ({"localized_after": 38, "lost": 0, "won": 2, "wrong_after": 1}, "activate", "patch_worse"),
        ({"places": 0, "localized_before": 0, "localized_after": 0}, "activate", None),
        ({"base": "0" * 64}, "activate", "patch_outdated"),
        ({"found": 0.75}, "activate", "self_test_worse"),
    ],
)
def test_a_patch_is_held_back_where_it_is_worse_or_outdated(maker, told, mode, held):
    maker.build(0.9)
    compared = {name: told.get(name, value) for name, value in COMPARED.items()}
    record = {**PATCH, "base": told.get("base", maker.active), "compared": compared}
    patched = replace(maker.manifest(told.get("found", 0.9), "patched"), source={"patch": record})
    found = maker.catalog.reason_to_hold("hall", patched, BY_DEFAULT, mode)
    assert (None if found is None else found.code) == held


@pytest.mark.parametrize(("in_part", "is_found"), [(0, False), (10, False), (11, True), (100, True)])
def test_many_places_mapped_in_part_are_a_finding(in_part, is_found):
    tested = {"mapped": {"places": 100, "in_part": in_part}}
    found = findings_of(Manifest({}, self_test=tested))
    assert [one.code for one in found] == (["map_in_part"] if is_found else [])
    if is_found:
        assert f"Of 100 places, {in_part} were mapped in part" in found[0].text


def test_versions_without_the_count_have_no_such_finding():
    for tested in ({}, {"mapped": None}, {"mapped": {"places": 0, "in_part": 0}}):
        assert findings_of(Manifest({}, self_test=tested)) == []
