"""The closed loop: a world changes, robots are localized in it, and the map is patched by what they saw."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from numpy.typing import NDArray

from firstfix.builds.options import BuildOptions
from firstfix.engine.index import MapIndex
from firstfix_builder.job.run_build import run_build
from firstfix_builder.worker import build_here
from tests.changed_yard import GONE, NEW, ChangedYard
from tests.small_world import SmallWorld, begun_as

if TYPE_CHECKING:
    from firstfix_builder.job.build_job import BuildResult

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]


class Place(ChangedYard):
    """A store with the map of the yard, and the yard as it is now."""

    def __init__(self, world: SmallWorld, folder: Path) -> None:
        super().__init__(world, folder, f"file://{folder}/store", "yard")

    def build(self, build_id: str, **changes: Any) -> dict[str, Any]:
        """Runs a build of the yard as the service does. Returns its status."""
        self.catalog.builds.put(build_id, {**self.request, **changes})
        options = BuildOptions(
            store=self.url, build_id=build_id, work=self.folder / "work", sandbox="off", log_level="critical"
        )
        run_build(options, partial(build_here, options, None))
        return self.catalog.builds.status(build_id)

    def patch(self, build_id: str, base: str, mode: str = "activate") -> dict[str, Any]:
        """Runs the build of a patch. Returns its status."""
        return self.build(build_id, patch={"base": base, "mode": mode})


@pytest.fixture(scope="module")
def place(
    small_world: SmallWorld, cloud_version: BuildResult, tmp_path_factory: pytest.TempPathFactory
) -> Place:
    folder = tmp_path_factory.mktemp("patched")
    begun_as(cloud_version, folder / "work")
    return Place(small_world, folder)


def points_in(index: MapIndex, box: NDArray[np.float64]) -> int:
    """Number of the map's fine surface cells in a box, above the floor."""
    low, high = box[0] + [-0.05, -0.05, 0.25], box[1] + 0.05
    grid = index.surface.fine
    step = np.arange(0.05, 1.0, 0.1)
    at = low + (high - low) * np.stack(np.meshgrid(step, step, step, indexing="ij"), axis=-1).reshape(-1, 3)
    row = grid.nearest(np.ascontiguousarray(at - grid.corner, np.float32))
    return len(np.unique(row[row >= 0]))


def test_a_changed_world_becomes_a_patched_map(place: Place) -> None:
    base = str(place.build("b1")["version"])
    assert place.catalog.active_version("yard") == base
    before = place.localizer(base)
    nothing = place.patch("b2", base)
    assert nothing["state"] == "failed"
    assert "nothing to patch" in nothing["error"]["detail"]

    place.ask(before, base, ["key:ann"], range(4), 6)
    lonely = place.patch("b3", base)
    assert lonely["state"] == "failed"
    assert "of 1 robots" in lonely["error"]["detail"]
    assert place.catalog.active_version("yard") == base

    place.ask(before, base, ["address:10.0.0.7"], range(4), 2)  # anybody: it counts for nothing
    errors_m = place.ask(before, base, ["key:bob"], range(4), 6)
    assert len(errors_m) >= 10
    assert max(errors_m) < 0.1
    status = place.patch("b4", base)
    assert status["state"] == "succeeded", status
    patched = str(status["version"])
    assert status["activated"], status["findings"]
    assert place.catalog.active_version("yard") == patched != base
    assert [one["code"] for one in status["findings"]] == ["map_patched"]
    record = place.catalog.manifest("yard", patched).source["patch"]
    assert (record["base"], record["robots"]) == (base, 2)
    assert record["compared"]["places"] >= 10
    areas = {one["kind"]: np.array([one["low_m"], one["high_m"]]) for one in record["areas"]}
    assert np.abs(areas["gone"] - GONE).max() < 0.6
    assert np.abs(areas["new"] - NEW).max() < 0.6

    after = place.localizer(patched)
    assert points_in(before.index, GONE) > 200
    assert points_in(after.index, GONE) < 0.1 * points_in(before.index, GONE)
    assert points_in(before.index, NEW) == 0
    assert points_in(after.index, NEW) > 100
    errors_m = place.ask(after, patched, ["key:cat"], [5], 6)
    assert max(errors_m) < 0.1

    assert place.catalog.roll_back("yard") == base
    assert place.localizer(base).index.surface.fine.planes.shape == before.index.surface.fine.planes.shape
    proposed = place.patch("b5", base, mode="propose")
    assert (proposed["version"], proposed["activated"]) == (patched, False)
    assert [one["code"] for one in proposed["findings"]] == ["map_patched", "patch_proposed"]
    assert place.catalog.active_version("yard") == base
    place.catalog.activate("yard", patched)  # a person clicks
    assert place.catalog.active_version("yard") == patched
