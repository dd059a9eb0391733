"""The build flow as a whole: one digest however it is run, nothing left by what was stopped."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from firstfix.build_config import BuildConfig
from firstfix.errors import BuildCancelled, InvalidOption, MalformedData
from firstfix.shared_stages import SharedStages
from firstfix.store import Store
from firstfix_builder.pipeline import STAGES, build_version
from small_world import CONFIG

BUILD_AND_DIE = """
import json, os, sys
from pathlib import Path
from firstfix.build_config import BuildConfig
from firstfix_builder.pipeline import build_version

def main():
    source, work, config, deadly = sys.argv[1:]
    def progress(stage, fraction):
        if stage == deadly:
            os.kill(os.getpid(), 9)
    built = build_version(Path(source), BuildConfig.parse(json.loads(config)), Path(work), progress=progress)
    print(built.manifest.digest)

if __name__ == "__main__":
    main()
"""


def test_a_build_killed_in_every_stage_ends_with_the_same_digest(small_map, small_version, tmp_path):
    script = tmp_path / "build_and_die.py"
    script.write_text(BUILD_AND_DIE)

    def build(deadly: str) -> subprocess.CompletedProcess[str]:
        command = [
            sys.executable,
            str(script),
            str(small_map),
            str(tmp_path / "work"),
            json.dumps(CONFIG),
            deadly,
        ]
        return subprocess.run(command, capture_output=True, text=True)

    for stage in STAGES:
        assert build(stage).returncode == -9
    finished = build("none")
    assert finished.returncode == 0, finished.stderr
    assert finished.stdout.strip() == small_version.manifest.digest


def test_finished_stages_are_not_done_again(small_map, small_version, small_work, monkeypatch):
    import firstfix_builder.build_stages as stages

    def never(*arguments: object, **more: object) -> None:
        raise AssertionError("done again")

    for stage in ("read_map", "sample_fitting_viewpoints", "template_chunks", "self_test"):
        monkeypatch.setattr(stages, stage, never)
    again = build_version(small_map, BuildConfig.parse(CONFIG), small_work)
    assert again.manifest.digest == small_version.manifest.digest


def test_a_build_goes_on_at_another_machine_from_the_last_finished_stage(
    small_map, small_version, tmp_path, monkeypatch
):
    import firstfix_builder.build_stages as stages

    shared = SharedStages(Store.open(f"file://{tmp_path / 'store'}"))
    reached: list[str] = []
    with pytest.raises(BuildCancelled):
        build_version(
            small_map,
            BuildConfig.parse(CONFIG),
            tmp_path / "first",
            progress=lambda stage, fraction: reached.append(stage),
            cancelled=lambda: reached[-1:] == ["learn_keys"],
            shared=shared,
        )

    def never(*arguments: object, **more: object) -> None:
        raise AssertionError("done again")

    for name in ("read_map", "sample_fitting_viewpoints", "template_chunks", "cluster_chunks"):
        monkeypatch.setattr(stages, name, never)
    built = build_version(small_map, BuildConfig.parse(CONFIG), tmp_path / "second", shared=shared)
    assert built.manifest.digest == small_version.manifest.digest


def test_a_build_leaves_no_chunks(small_version):
    folder = small_version.directory.parent / "chunks"
    assert folder.exists()
    assert [path for path in folder.rglob("*") if path.is_file()] == []


def test_another_config_is_another_version(small_map, small_version, small_work):
    wider = BuildConfig.parse({**CONFIG, "viewpoints": {"spacing_m": 1.5}})
    other = build_version(small_map, wider, small_work)
    assert other.manifest.digest != small_version.manifest.digest
    assert other.manifest.counts["templates"] < small_version.manifest.counts["templates"]


@pytest.mark.parametrize("stage", STAGES)
def test_cancel_stops_before_the_next_stage(small_map, tmp_path, stage):
    seen: list[str] = []
    with pytest.raises(BuildCancelled):
        build_version(
            small_map,
            BuildConfig.parse(CONFIG),
            tmp_path,
            progress=lambda name, fraction: seen.append(name),
            cancelled=lambda: stage in seen,
        )
    assert STAGES.index(seen[-1]) <= STAGES.index(stage)


def test_progress_names_every_stage_in_order(small_map, small_work):
    seen: list[tuple[str, float]] = []
    build_version(
        small_map,
        BuildConfig.parse(CONFIG),
        small_work,
        progress=lambda stage, fraction: seen.append((stage, fraction)),
    )
    assert [stage for stage, fraction in seen if fraction == 0.0] == list(STAGES)
    assert all(0 <= fraction <= 1 for _, fraction in seen)


def test_an_unreadable_source_names_itself(tmp_path):
    broken = tmp_path / "broken.pcd"
    broken.write_bytes(b"VERSION 0.7\nFIELDS x y z\n")
    with pytest.raises(MalformedData, match=r"broken\.pcd"):
        build_version(broken, BuildConfig(), tmp_path / "work")


@pytest.mark.parametrize(
    ("config", "said"),
    [
        ({"sensr": "os1-64"}, "sensr"),
        ({"sensor": "os9"}, "no sensor preset"),
        ({"sensor": {"preset": "vlp-16", "max_range_m": -1}}, "max_range_m"),
        ({"viewpoints": {"spacing_m": 0}}, "viewpoints.spacing_m"),
        ({"engine": {"search": {"candidates": 0}}}, "engine.search.candidates"),
        ([], "build config"),
    ],
)
def test_a_wrong_config_says_what_is_wrong(config, said):
    with pytest.raises(InvalidOption, match=said):
        BuildConfig.parse(config)


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
