"""A caller floods in every way, a moment each: ``python -m tests.faults neighbours`` does it for long."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.faults.flooders import FLOODS
from tests.faults.neighbours import neighbours

if TYPE_CHECKING:
    from firstfix_builder.job.build_job import BuildResult

pytestmark = pytest.mark.slow


@pytest.mark.timeout(1200)
def test_every_query_beside_a_flood_is_answered(coarse_version: BuildResult, tmp_path: Path):
    figures = neighbours(coarse_version.directory, tmp_path, seconds=1.0)
    assert figures["floods"].keys() == FLOODS.keys()
    for name, one in figures["floods"].items():
        assert one["robot"]["asked"] == one["robot"]["answered"] > 0, (name, one)
        assert one["flooder"]["connections"] >= FLOODS[name].connections, name
