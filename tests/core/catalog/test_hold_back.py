"""Versions whose self-test is bad are published, and not activated."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from firstfix.builds.config import ActivateConfig, PatchMode
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import Manifest
from firstfix.store.store import Store

BY_DEFAULT = ActivateConfig()


class Maker:
    """Publishes versions as a build does."""

    def __init__(self, folder: Path) -> None:
        self.catalog = Catalog(Store.open(str(folder / "store")))
        self.folder = folder

    def manifest(self, localized: float | None, label: str = "", *, provisional: bool = False) -> Manifest:
        directory = self.folder / f"{localized}{label}"
        directory.mkdir(exist_ok=True)
        (directory / "index.bin").write_bytes(f"{localized} {label}".encode())
        tested = {} if localized is None else {"queries": 120, "localized": localized}
        return Manifest.for_directory(directory, self_test=tested, provisional=provisional)

    def build(self, localized: float | None, config: ActivateConfig = BY_DEFAULT, **made: bool) -> str | None:
        """Returns the code of the finding because of which the version was not activated."""
        manifest = self.manifest(localized, **made)
        held = self.catalog.reason_to_hold("hall", manifest, config)
        directory = self.folder / f"{localized}"
        self.catalog.publish("hall", directory, manifest, activate=held is None, build_id="b")
        assert manifest.digest in self.catalog.state("hall").published or manifest.provisional
        return None if held is None else held.code

    @property
    def active(self) -> str | None:
        return self.catalog.active_version("hall")


@pytest.fixture
def maker(tmp_path: Path) -> Maker:
    return Maker(tmp_path)


def test_a_version_below_the_floor_is_published_and_the_one_before_serves(maker: Maker):
    assert maker.build(0.9) is None
    before = maker.active
    assert maker.build(0.49) == "self_test_low"
    assert maker.active == before
    assert len(maker.catalog.versions("hall")) == 2


def test_a_version_that_is_clearly_worse_than_the_active_one_is_not_activated(maker: Maker):
    assert maker.build(0.9) is None
    assert maker.build(0.81) is None, "within 10 points"
    before = maker.active
    assert maker.build(0.7) == "self_test_worse"
    assert maker.active == before
    assert maker.build(0.7, ActivateConfig(max_loss=1.0)) is None
    assert maker.active != before


def test_the_user_may_say_otherwise(maker: Maker):
    assert maker.build(0.2, ActivateConfig(min_localized=0.0)) is None
    assert maker.active is not None
    assert maker.build(None) is None, "its config wanted no self-test"


def test_the_active_version_is_not_held_back_when_it_is_built_again(maker: Maker):
    maker.build(0.3, ActivateConfig(min_localized=0.0))
    before = maker.active
    assert maker.build(0.3) is None
    assert maker.active == before


def test_a_first_map_that_fails_serves_nothing_not_even_provisionally(maker: Maker):
    assert maker.build(None, provisional=True) is None
    assert maker.active is not None
    assert maker.build(0.2) == "self_test_low"
    assert maker.active is None
    assert len(maker.catalog.versions("hall")) == 1, "the provisional version is retired"


def test_a_person_may_activate_it(maker: Maker):
    maker.build(0.2)
    (version,) = maker.catalog.versions("hall")
    maker.catalog.activate("hall", version.version)
    assert maker.active == version.version


COMPARED = {"places": 40, "localized_before": 36, "localized_after": 36, "lost": 0, "won": 0} | {
    "wrong_before": 0,
    "wrong_after": 0,
}


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
    ],
)
def test_a_patch_must_not_be_worse_where_nothing_has_changed(
    maker: Maker, told: dict[str, int], mode: PatchMode, held: str | None
):
    maker.build(0.9)
    record = {"base": maker.active, "compared": {**COMPARED, **told}}
    patched = replace(maker.manifest(0.9, "patched"), source={"patch": record})
    found = maker.catalog.reason_to_hold("hall", patched, BY_DEFAULT, mode)
    assert (None if found is None else found.code) == held


def test_a_patch_of_a_version_that_is_no_longer_active_waits(maker: Maker):
    maker.build(0.9)
    record = {"base": "0" * 64, "compared": COMPARED}
    patched = replace(maker.manifest(0.9, "patched"), source={"patch": record})
    found = maker.catalog.reason_to_hold("hall", patched, BY_DEFAULT, "activate")
    assert found is not None
    assert found.code == "patch_outdated"


def test_a_patch_with_a_bad_self_test_is_not_activated_either(maker: Maker):
    maker.build(0.9)
    record = {"base": maker.active, "compared": COMPARED}
    patched = replace(maker.manifest(0.7, "patched"), source={"patch": record})
    found = maker.catalog.reason_to_hold("hall", patched, BY_DEFAULT, "activate")
    assert found is not None
    assert found.code == "self_test_worse"
