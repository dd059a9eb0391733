"""The build flow as a whole: one digest however it is run, nothing left by what was stopped."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

from firstfix.builds.config import BuildConfig
from firstfix.builds.options import STAGES
from firstfix.builds.shared_stages import SharedStages
from firstfix.engine.calibration import Calibration
from firstfix.engine.index import MapIndex
from firstfix.errors import BuildCancelled, BuildFailed, InvalidOption
from firstfix.store.store import Store
from firstfix_builder import build_stages
from firstfix_builder.pipeline import build_version
from firstfix_builder.sources import map_reader
from tests.small_world import COARSE_CONFIG

# A process for each build, forked from one that has imported what they need. Prints how each of them ended.
BUILD_AND_DIE = """
import json, os, sys
from pathlib import Path

def main():
    from firstfix.builds.config import BuildConfig
    from firstfix_builder.pipeline import build_version

    source, work, config, *deadly = sys.argv[1:]

    def build(last):
        def progress(stage, fraction):
            if stage == last:
                os.kill(os.getpid(), 9)
        config_ = BuildConfig.parse(json.loads(config))
        print(build_version(Path(source), config_, Path(work), progress=progress).manifest.digest, flush=True)

    for last in deadly:
        child = os.fork()
        if not child:
            try:
                build(last)
            finally:
                os._exit(0)
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)

if __name__ == "__main__":
    main()
"""


def forbid(monkeypatch: pytest.MonkeyPatch, *names: str) -> None:
    """Lets a build fail that reads its map again, or calls one of these functions of its stages."""

    def never(*arguments: object, **more: object) -> None:
        raise AssertionError("done again")

    monkeypatch.setattr(map_reader, "write_level_map", never)
    for name in names:
        monkeypatch.setattr(build_stages, name, never)


@pytest.mark.slow
def test_a_build_killed_in_every_stage_ends_with_the_same_digest(small_map, coarse_version, tmp_path):
    script = tmp_path / "build_and_die.py"
    script.write_text(BUILD_AND_DIE)
    command = [sys.executable, str(script), str(small_map), str(tmp_path / "work"), json.dumps(COARSE_CONFIG)]
    done = subprocess.run([*command, *STAGES, "none"], capture_output=True, text=True, check=False)
    killed = ["-9"] * len(STAGES)
    assert done.stdout.split() == [*killed, coarse_version.manifest.digest, "0"], done.stderr


def test_finished_stages_are_not_done_again(small_map, coarse_version, coarse_work, monkeypatch):
    forbid(monkeypatch, "fitting_viewpoints", "template_chunks", "write_self_test")
    again = build_version(small_map, BuildConfig.parse(COARSE_CONFIG), coarse_work)
    assert again.manifest.digest == coarse_version.manifest.digest


def test_a_build_goes_on_at_another_machine_from_the_last_finished_stage(
    small_map, coarse_version, tmp_path, monkeypatch
):
    shared = SharedStages(Store.open(f"file://{tmp_path / 'store'}"))
    reached: list[str] = []
    with pytest.raises(BuildCancelled):
        build_version(
            small_map,
            BuildConfig.parse(COARSE_CONFIG),
            tmp_path / "first",
            progress=lambda stage, fraction: reached.append(stage),
            cancelled=lambda: reached[-1:] == ["learn_keys"],
            shared=shared,
        )

    forbid(monkeypatch, "fitting_viewpoints", "template_chunks", "cluster_chunks")
    built = build_version(small_map, BuildConfig.parse(COARSE_CONFIG), tmp_path / "second", shared=shared)
    assert built.manifest.digest == coarse_version.manifest.digest


def test_a_provisional_version_comes_first_and_changes_nothing(small_map, coarse_version, tmp_path):
    seen, stages = [], []

    def publish(early):
        seen.append(early)
        assert MapIndex.load(early.directory).calibration == Calibration()

    full = build_version(
        small_map,
        BuildConfig.parse(COARSE_CONFIG),
        tmp_path / "work",
        progress=lambda stage, fraction: stages.append(stage),
        publish_provisional=publish,
    )
    assert full.manifest.digest == coarse_version.manifest.digest
    assert not full.manifest.provisional
    (early,) = seen
    assert early.manifest.provisional
    assert early.manifest.self_test == {}
    early.manifest.verify_directory(early.directory)
    in_order = list(dict.fromkeys(stages))
    assert in_order == [STAGES[0], "provisional", *STAGES[1:]]


def test_a_map_without_a_provisional_version_fails_as_it_would_have(tmp_path):
    pit = tmp_path / "pit.ply"
    trimesh.Trimesh([[0, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2]], process=False).export(pit)
    with pytest.raises(BuildFailed, match="no floor"):
        build_version(pit, BuildConfig(), tmp_path / "work", publish_provisional=pytest.fail)


def test_another_config_is_another_version(small_map, coarse_version, coarse_work):
    wider = BuildConfig.parse({**COARSE_CONFIG, "viewpoints": {"spacing_m": 2.0}})
    other = build_version(small_map, wider, coarse_work)
    assert other.manifest.digest != coarse_version.manifest.digest
    assert other.manifest.counts["templates"] < coarse_version.manifest.counts["templates"]


@pytest.mark.parametrize("stage", STAGES)
def test_cancel_stops_before_the_next_stage(small_map, coarse_work, stage):
    for made in (coarse_work / "stages").iterdir():  # what comes before it is there
        if STAGES.index(json.loads((made / "stage.json").read_text())["stage"]) >= STAGES.index(stage):
            shutil.rmtree(made)
    seen: list[str] = []
    with pytest.raises(BuildCancelled):
        build_version(
            small_map,
            BuildConfig.parse(COARSE_CONFIG),
            coarse_work,
            progress=lambda name, fraction: seen.append(name),
            cancelled=lambda: stage in seen,
        )
    assert STAGES.index(seen[-1]) <= STAGES.index(stage)


def test_progress_names_every_stage_in_order(small_map, coarse_work):
    seen: list[tuple[str, float]] = []
    build_version(
        small_map,
        BuildConfig.parse(COARSE_CONFIG),
        coarse_work,
        progress=lambda stage, fraction: seen.append((stage, fraction)),
    )
    assert [stage for stage, fraction in seen if fraction == 0.0] == list(STAGES)
    assert all(0 <= fraction <= 1 for _, fraction in seen)


def test_a_config_file_is_yaml_or_json(tmp_path: Path):
    for name, text in (
        ("a.yaml", "sensor: vlp-16\nlevel: false\n"),
        ("b.json", '{"sensor": "vlp-16", "level": false}'),
    ):
        (tmp_path / name).write_text(text)
        config = BuildConfig.from_file(tmp_path / name)
        assert (config.sensor, config.level) == ("vlp-16", False)
    (tmp_path / "c.yaml").write_text("{a: [")
    with pytest.raises(InvalidOption):
        BuildConfig.from_file(tmp_path / "c.yaml")


@pytest.mark.slow
def test_sessions_stand_in_the_manifest(small_world, tmp_path):
    rng = np.random.default_rng(2)
    corner = small_world.vertices[small_world.triangles]  # (t, 3, 3)
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    of = corner[rng.choice(len(corner), 60_000, p=area / area.sum())]
    cloud = np.einsum("nij,ni->nj", of, rng.dirichlet(np.ones(3), len(of)))
    T_map_session = np.eye(4)
    T_map_session[:3, 3] = [100.0, -20.0, 0.5]
    np.save(tmp_path / "west.npy", cloud[cloud[:, 0] < 2])
    np.save(tmp_path / "east.npy", cloud[cloud[:, 0] > -2] - T_map_session[:3, 3])
    sessions = [{"source": "west.npy"}, {"source": "east.npy", "T_map_session": T_map_session.tolist()}]
    folder = tmp_path / "sessions"
    folder.mkdir()
    for one in sessions:
        (tmp_path / str(one["source"])).rename(folder / str(one["source"]))
    (folder / "sessions.yaml").write_text(json.dumps({"sessions": sessions}))
    manifest = build_version(folder, BuildConfig.parse(COARSE_CONFIG), tmp_path / "work").manifest
    west, east = manifest.source["sessions"]
    assert (west["source"], east["source"]) == ("west.npy", "east.npy")
    np.testing.assert_allclose(east["T_map_session"], T_map_session, atol=1e-6)
    low, high = np.array(manifest.bounds)
    np.testing.assert_allclose(high - low, [16.4, 12.4, 3.2], atol=0.3)  # the whole yard, in one piece
