"""A build upon the version before: what it keeps, when it keeps nothing, and that nothing is kept wrongly."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from firstfix.builds.config import ActivateConfig, BuildConfig
from firstfix.catalog.hold_back import reason_to_hold
from firstfix.catalog.manifest import MADE_BY_FILE, SURFACE_FILE
from firstfix.engine.index import CALIBRATION_FILE, MAP_FILE, MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.engine.retrieval.cascade import PREFIX, PROJECTION_FILE
from firstfix.errors import BuildCancelled
from firstfix_builder.execution.build_trace import BuildTrace
from firstfix_builder.job.build_job import BuildResult
from firstfix_builder.pipeline import build_version
from firstfix_builder.rebuild import kept
from firstfix_builder.rebuild.base_version import BaseVersion
from firstfix_builder.rebuild.kept import ChangedTemplates
from firstfix_builder.self_test import changed_part
from firstfix_builder.self_test.changed_part import ChangedPart
from firstfix_builder.self_test.real_scans import RealScans
from firstfix_builder.simulation.simulate import Simulator
from tests.builder.test_incremental import CONFIG, corridor

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]


@dataclass(frozen=True)
class Rebuilds:
    """A corridor's version, and the builds of what it has become.

    Attributes:
        base: folder of the version before, and its digest.
        exact: the build of the changed corridor from nothing.
    """

    folder: Path
    base: Path
    digest: str
    exact: BuildResult

    def build(
        self, cancelled: Callable[[], bool] = lambda: False, **config: Any
    ) -> tuple[BuildResult, dict[str, tuple[int, int]]]:
        """Returns the version of the changed corridor, and the chunks of each stage with those reused."""
        with BuildTrace("b", "m", None) as trace:
            built = build_version(
                self.folder / "after.ply",
                BuildConfig.parse({**CONFIG, "base": self.digest, **config}),
                self.folder / "work",
                base=self.base,
                progress=lambda stage, _: trace.tick(stage),
                cancelled=cancelled,
            )
            trace.end("succeeded")
        return built, {s.stage: (s.chunks, s.chunks_reused) for s in trace.stages if s.chunks}

    def forget_self_tests(self) -> None:
        for record in (self.folder / "work" / "stages").glob("*/stage.json"):
            if json.loads(record.read_text())["stage"] == "self_test":
                shutil.rmtree(record.parent)

    def base_of(self, source: str = "another", **config: Any) -> BaseVersion | None:
        return BaseVersion.of(self.base, BuildConfig.parse({**CONFIG, "base": self.digest, **config}), source)


@pytest.fixture(scope="module")
def rebuilds(tmp_path_factory: pytest.TempPathFactory) -> Rebuilds:
    folder = tmp_path_factory.mktemp("rebuilds")
    config = BuildConfig.parse(CONFIG)
    before, after = corridor(folder / "before.ply"), corridor(folder / "after.ply", changed=True)
    first = build_version(before, config, folder / "work")
    shutil.copytree(first.directory, folder / "base")
    exact = build_version(after, config, folder / "fresh")
    return Rebuilds(folder, folder / "base", first.manifest.digest, exact)


@pytest.fixture(autouse=True)
def half_may_change(monkeypatch: pytest.MonkeyPatch) -> None:
    """In a corridor a moved box is seen from far."""
    monkeypatch.setattr(kept, "MAX_CHANGED", 0.5)


def test_keys_calibration_and_surface_are_kept_and_all_else_is_that_of_a_build_from_nothing(
    rebuilds: Rebuilds,
):
    built, chunks = rebuilds.build()
    exact = rebuilds.exact
    for name in ("position_m", "height_m", "occupancy"):
        file = f"{PREFIX}{name}.npy"
        assert (built.directory / file).read_bytes() == (exact.directory / file).read_bytes()
    assert (built.directory / SURFACE_FILE).read_bytes() == (exact.directory / SURFACE_FILE).read_bytes()
    before, here, from_nothing = (
        np.load(one / MAP_FILE) for one in (rebuilds.base, built.directory, exact.directory)
    )
    assert cKDTree(from_nothing).query(here)[0].max() < 1.0
    assert cKDTree(here).query(from_nothing)[0].max() < 1.0
    far = before[before[:, 0] < 100]  # the box that has moved stands at the other end
    np.testing.assert_array_equal(here[here[:, 0] < 100], far)
    for name in (PROJECTION_FILE, CALIBRATION_FILE):
        kept_file = (built.directory / name).read_bytes()
        assert kept_file == (rebuilds.base / name).read_bytes()
        assert kept_file != (exact.directory / name).read_bytes()
    assert "learn_keys" not in chunks, "no scan is made to learn from"
    manifest = built.manifest
    assert manifest.config["base"] == rebuilds.digest
    assert "base" not in exact.manifest.config
    told = manifest.source["rebuilt"]
    assert told["base"] == told["keys_of"] == told["calibration_of"] == rebuilds.digest
    assert 0 < told["changed"] < manifest.counts["templates"] / 2
    tested = manifest.self_test
    assert tested["queries"] == tested["changed"]["queries"] + tested["unchanged"]["queries"] == 8
    assert manifest.digest != exact.manifest.digest


def test_what_has_changed_too_much_is_built_as_from_nothing(
    rebuilds: Rebuilds, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(kept, "MAX_CHANGED", 0.0)
    built, _ = rebuilds.build()
    assert built.manifest.digest == rebuilds.exact.manifest.digest


def test_an_exact_build_is_one_from_nothing(rebuilds: Rebuilds):
    built, _ = rebuilds.build(exact=True)
    assert built.manifest.digest == rebuilds.exact.manifest.digest


def test_a_calibration_that_the_scans_refute_is_taught_anew(
    rebuilds: Rebuilds, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(changed_part, "upper_bound", lambda *_: -1.0)
    rebuilds.forget_self_tests()
    built, _ = rebuilds.build()
    rebuilds.forget_self_tests()
    told = built.manifest.source["rebuilt"]
    assert told["keys_of"] == rebuilds.digest
    assert told["calibration_of"] is None
    tested = built.manifest.self_test
    assert tested["changed"]["queries"] > 0, "a changed part that is not found is held back all the same"
    assert tested["outside"] == CONFIG["self_test"]["outside"]


def test_a_cancelled_rebuild_goes_on_with_the_same_version(rebuilds: Rebuilds, tmp_path: Path):
    whole, _ = rebuilds.build()
    again = replace(rebuilds, folder=tmp_path)
    shutil.copy(rebuilds.folder / "after.ply", tmp_path)
    asked = 0

    def cancelled() -> bool:
        nonlocal asked
        asked += 1
        return asked == 60

    with pytest.raises(BuildCancelled):
        again.build(cancelled)
    built, _ = again.build()
    assert built.manifest.digest == whole.manifest.digest


def test_a_version_is_held_back_whose_changed_part_is_not_found(rebuilds: Rebuilds, tmp_path: Path):
    built, _ = rebuilds.build()
    bad = tmp_path / "bad"
    shutil.copytree(built.directory, bad)
    base = rebuilds.base_of()
    assert base is not None
    index = MapIndex.load(bad, base.calibration)
    changed = ChangedTemplates.of(base.templates, index.cascade.templates)
    positions_m = index.cascade.templates.position_m
    lost = positions_m[:, 0] > positions_m[changed.rows, 0].min() - 3
    occupancy = np.load(bad / f"{PREFIX}occupancy.npy")
    occupancy[lost] = np.random.default_rng(0).integers(0, 256, occupancy[lost].shape)
    np.save(bad / f"{PREFIX}occupancy.npy", occupancy)
    points = np.load(bad / MAP_FILE)
    mesh = rebuilds.folder / "after.ply"
    import trimesh

    surface = trimesh.load(mesh, process=False)
    config = BuildConfig.parse({**CONFIG, "self_test": {"queries": 24}})
    part = ChangedPart(changed.rows, changed.share, base.manifest.self_test, base.calibration)
    with ThreadPoolExecutor(2) as threads:
        found = part.test(
            Localizer(MapIndex.load(bad, base.calibration), explains=False),
            Simulator(surface.vertices, surface.faces),
            config.sensor_model,
            config.self_test,
            RealScans.of(no_scans(), points, no_scans()),
            threads,
            lambda _: None,
            lambda: False,
        )
    assert found.parts["changed"]["found"] < 0.7
    manifest = replace(built.manifest, self_test={**built.manifest.self_test, "found": 0.9, **found.parts})
    held = reason_to_hold("m", manifest, None, ActivateConfig(), "off")
    assert held is not None
    assert held.code == "self_test_changed_low"


def no_scans() -> Any:
    from firstfix_builder.sources.read_map.held_out import HeldOut

    return HeldOut()


def test_nothing_is_kept_of_another_config_source_or_version(rebuilds: Rebuilds):
    assert rebuilds.base_of() is not None
    assert rebuilds.base_of(learn_keys={"scans": 61}) is None
    assert rebuilds.base_of(base="0" * 64) is None
    assert rebuilds.base_of(rebuilds.exact.manifest.source["sha256"]) is not None
    same = BaseVersion.of(rebuilds.base, BuildConfig.parse({**CONFIG, "base": rebuilds.digest}), "x")
    assert same is not None
    assert rebuilds.base_of(same.manifest.source["sha256"]) is None


@pytest.mark.parametrize("damage", ["release", "no surface", "no manifest", "no manifest's bytes"])
def test_nothing_is_kept_of_another_release_or_a_damaged_version(
    rebuilds: Rebuilds, tmp_path: Path, damage: str
):
    base = tmp_path / "base"
    shutil.copytree(rebuilds.base, base)
    if damage == "release":
        made_by = json.loads((base / MADE_BY_FILE).read_text())
        (base / MADE_BY_FILE).write_text(json.dumps({**made_by, "release": "0.0.9"}))
    elif damage == "no surface":
        (base / SURFACE_FILE).unlink()
    elif damage == "no manifest":
        (base / "manifest.json").unlink()
    else:
        (base / "manifest.json").write_bytes(b"{")
    assert replace(rebuilds, base=base).base_of() is None


def test_changes_add_up_over_rebuilds(rebuilds: Rebuilds, monkeypatch: pytest.MonkeyPatch):
    built, _ = rebuilds.build()
    once = built.manifest.source["rebuilt"]["changed_since_taught"]
    assert once > 0
    again = BaseVersion(built.directory, built.manifest)
    found = kept.Kept.of(again, again.engine, again.templates)
    assert found is not None
    assert found.since_taught == once, "nothing has changed since"
    assert found.record(is_taught_anew=False)["keys_of"] == rebuilds.digest, "and not the version between"
    monkeypatch.setattr(kept, "MAX_CHANGED", once / 2)
    assert kept.Kept.of(again, again.engine, again.templates) is None
