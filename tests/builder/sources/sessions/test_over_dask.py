"""Sessions and the provisional version on a real Dask cluster: the same bytes as with threads."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from firstfix.builds.config import BuildConfig
from firstfix.builds.options import BuildOptions
from firstfix.errors import BuildCancelled
from firstfix.store.store import Store
from firstfix_builder.job.build_job import BuildResult
from firstfix_builder.pipeline import build_version
from tests.builder.execution.dask_cluster import dask_cluster
from tests.builder.sources.sessions.merged_sessions import MergedSessions

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]  # a cluster is started, and two sessions aligned


def provisional(folder: Path, work: Path, options: BuildOptions) -> BuildResult:
    """The provisional version. Its build is then cancelled."""
    found: list[BuildResult] = []
    with pytest.raises(BuildCancelled):
        build_version(
            folder,
            BuildConfig(),
            work,
            options=options,
            cancelled=lambda: bool(found),
            publish_provisional=found.append,
        )
    return found[0]


def test_sessions_and_a_provisional_version_are_the_same_as_with_threads(
    two_sessions: MergedSessions, tmp_path: Path
):
    folder = two_sessions.source
    near = provisional(folder, two_sessions.begin(tmp_path / "near"), BuildOptions())
    store = tmp_path / "store"
    with dask_cluster(tmp_path / "dask", 2) as cluster:
        far = provisional(folder, tmp_path / "far", BuildOptions(executor=cluster.url, store=str(store)))
    assert far.manifest.digest == near.manifest.digest
    assert far.manifest.source["sessions"][1]["aligned"]
    shared = Store.open(str(store))
    stages = [json.loads(shared.get(key))["stage"] for key in shared.list("stages") if key.endswith(".json")]
    assert stages.count("map") == 3, "workers read both sessions' maps, and the thinned one"
    assert stages.count("mesh") == 3
    assert "chunk" in stages
