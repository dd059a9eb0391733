"""Output and exit codes of the command line."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from firstfix.answer.localization import Hypothesis, Localization, Reason, Verdict
from firstfix.answer.quality import AlignmentQuality
from firstfix.transform import make_transform, quaternion_of, rotation_z
from firstfix_cli.main import run
from tests.fake_service import VERSIONS, FakeService

POSE = make_transform(rotation_z(0.5), [12.0, -4.0, 1.5])
FIT = AlignmentQuality(0.8, 0.7, 0.01)
LOCALIZED, AMBIGUOUS, REJECTED, OFF, FALSE = range(
    100, 105
)  # point counts: how the service tells scans apart


AS_INSTALLED = "import sys; sys.argv[0] = 'firstfix'; from firstfix_cli.main import run; run()"


def localized(T: np.ndarray) -> Localization:
    return Localization(
        Verdict.LOCALIZED,
        T_map_sensor=T,
        T_map_base=T,
        covariance=np.eye(6) * 1e-6,
        probability=0.97,
        hypotheses=(Hypothesis(T, AlignmentQuality(0.9, 0.8, 0.01), 0.97, 3),),
        map_id="hall",
        map_version=VERSIONS[0],
        timings_ms={"search": 1.25},
    )


def moved(off_m: float) -> np.ndarray:
    return make_transform(POSE[:3, :3], POSE[:3, 3] + [off_m, 0, 0])


@pytest.fixture
def service() -> Iterator[FakeService]:
    running = FakeService(
        {
            LOCALIZED: localized(moved(0.01)),
            AMBIGUOUS: Localization(
                Verdict.AMBIGUOUS,
                (Reason.SEVERAL_PLACES,),
                hypotheses=(Hypothesis(POSE, FIT, 0.5, 1), Hypothesis(moved(10), FIT, 0.5, 2)),
            ),
            REJECTED: Localization(Verdict.REJECTED, (Reason.LOW_INLIER_RATIO,)),
            OFF: localized(moved(0.3)),
            FALSE: localized(moved(30.0)),
        }
    )
    yield running
    running.stop()


@pytest.fixture
def scan(tmp_path):
    def write(count: int) -> Path:
        path = tmp_path / f"{count}.npy"
        np.save(path, np.random.default_rng(count).uniform(-9, 9, (count, 3)))
        return path

    return write


def ended(arguments: list[object]) -> int:
    with pytest.raises(SystemExit) as caught:
        run([str(argument) for argument in arguments])
    return int(caught.value.code or 0)


@pytest.mark.parametrize(
    ("count", "code", "says"),
    [
        (LOCALIZED, 0, "x 12.010  y -4.000  z 1.500 m  yaw 28.65 deg"),
        (AMBIGUOUS, 3, "ambiguous (several_places)"),
        (REJECTED, 4, "rejected (low_inlier_ratio)"),
    ],
)
def test_the_verdict_is_the_exit_code(service, scan, capsys, count, code, says):
    assert ended(["localize", scan(count), "--map", "hall", "--url", service.url]) == code
    out, err = capsys.readouterr()
    assert says in out
    assert err == ""


def test_the_old_name_of_the_floor_names_the_new_one(tmp_path, capsys):
    arguments = ["build", tmp_path / "x.ply", "--map-id", "hall", "--store", tmp_path, "--min-localized", 0.3]
    assert ended(arguments) == 2
    assert "--min-localized is --min-found now" in capsys.readouterr().err


def test_the_places_of_an_ambiguous_answer_are_shown(service, scan, capsys):
    ended(["localize", scan(AMBIGUOUS), "--map", "hall", "--url", service.url])
    assert capsys.readouterr().out.count("maybe") == 2


def test_json_is_the_answer(service, scan, capsys):
    arguments = ["localize", scan(LOCALIZED), "--map", "hall", "--url", service.url, "--json"]
    assert (
        ended([*arguments, "--gravity", "2,-1", "--max-candidates", 7, "--T-base-sensor", "0,0,1,0,0,0,1"])
        == 0
    )
    answer = Localization.from_mapping(json.loads(capsys.readouterr().out))
    np.testing.assert_allclose(answer.T_map_sensor, moved(0.01), atol=1e-12)
    (query,) = service.queries
    down = [float(v) for v in query["gravity"].split(",")]
    np.testing.assert_allclose(down, [np.sin(np.radians(-1)), -np.sin(np.radians(2)), -1], atol=1e-3)
    assert query["max_candidates"] == "7"
    assert query["T_base_sensor"].startswith("0.0,0.0,1.0,")


@pytest.mark.parametrize(
    ("extra", "says"),
    [
        (["--map", "yard"], "no map yard"),
        (["--map", "hall", "--gravity", "down"], "gravity is 2 or 3 numbers"),
        (["--map", "hall", "--store", "/tmp/x"], "give only one of --url, --zenoh and --store"),
    ],
)
def test_an_error_is_one_line_and_code_2(service, scan, capsys, extra, says):
    assert ended(["localize", scan(LOCALIZED), "--url", service.url, *extra]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert says in err
    assert err.startswith("firstfix: ")
    assert err.count("\n") == 1


def test_files_that_cannot_be_read_are_named(service, tmp_path, capsys):
    arguments = ["--map", "hall", "--url", service.url]
    assert ended(["localize", tmp_path / "nothere.pcd", *arguments]) == 2
    assert "nothere.pcd" in capsys.readouterr().err
    (tmp_path / "bad.pcd").write_bytes(b"no point cloud")
    assert ended(["localize", tmp_path / "bad.pcd", *arguments]) == 2
    assert "bad.pcd" in capsys.readouterr().err


def test_no_service_is_one_line(scan, capsys):
    arguments = ["localize", scan(LOCALIZED), "--map", "hall", "--url", "http://127.0.0.1:9", "--timeout", 1]
    assert ended(arguments) == 1, "it may be there later"
    assert capsys.readouterr().err.startswith("firstfix: no answer from http://127.0.0.1:9")


@pytest.mark.parametrize("arguments", [[], ["localize"], ["localize", "x.pcd"], ["fly"]])
def test_bad_usage_is_code_2(arguments, capsys):
    assert ended(arguments) == 2


def write_poses(path: Path, rows: list[tuple[Path, np.ndarray | None]]) -> Path:
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["scan", "tx", "ty", "tz", "qx", "qy", "qz", "qw"])
        for scan, T in rows:
            writer.writerow([scan.name, *([""] * 7 if T is None else [*T[:3, 3], *quaternion_of(T)])])
    return path


@pytest.fixture
def poses(tmp_path, scan) -> Path:
    rows = [(scan(count), POSE) for count in (LOCALIZED, OFF, REJECTED)] + [(scan(FALSE), None)]
    return write_poses(tmp_path / "poses.csv", rows)


def test_evaluate_writes_figures_details_and_a_picture(service, poses, tmp_path, capsys):
    files = {name: tmp_path / name for name in ("figures.json", "details.csv", "picture.png")}
    arguments = ["evaluate", poses, "--map", "hall", "--url", service.url]
    options = [
        "--json",
        files["figures.json"],
        "--details",
        files["details.csv"],
        "--plot",
        files["picture.png"],
    ]
    assert ended([*arguments, *options]) == 0
    figures = json.loads(files["figures.json"].read_text())
    assert figures["n"] == 4
    assert figures["success_0.05m"] == pytest.approx(1 / 3)
    assert figures["success_0.5m"] == pytest.approx(2 / 3)
    assert figures["median_error_m"] == pytest.approx(0.155)
    assert figures["false_accept_rate"] == pytest.approx(1 / 3)
    assert figures["verdicts"] == {"localized": 3, "ambiguous": 0, "rejected": 1}
    assert 0 < figures["ms"]["p50"] <= figures["ms"]["p99"] < 10_000
    with files["details.csv"].open() as file:
        details = list(csv.DictReader(file))
    assert [row["verdict"] for row in details] == ["localized", "localized", "rejected", "localized"]
    assert details[1]["error_m"] == "0.3000"
    assert files["picture.png"].read_bytes().startswith(b"\x89PNG")
    out = capsys.readouterr().out
    assert "4 scans: 3 localized, 0 ambiguous, 1 rejected" in out
    assert "33.3% within 0.05m" in out


def test_random_yaw_turns_the_scans_the_same_way_for_a_seed(service, tmp_path, scan):
    poses = write_poses(tmp_path / "poses.csv", [(scan(LOCALIZED), POSE), (scan(OFF), POSE)])
    for seed in (7, 7, 8):
        arguments = ["evaluate", poses, "--map", "hall", "--url", service.url, "--random-yaw", seed]
        assert ended([*arguments, "--json", tmp_path / f"{seed}.json"]) == 0
    first, again, other = (service.scans[k].points for k in (0, 2, 4))
    original = np.load(scan(LOCALIZED))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 0.1
    assert np.abs(first[:, :2] - original[:, :2]).max() > 0.1
    np.testing.assert_allclose(np.hypot(*first[:, :2].T), np.hypot(*original[:, :2].T), atol=0.02)
    # this service knows nothing of the turn, and the truth was turned: the headings must disagree
    figures = json.loads((tmp_path / "7.json").read_text())
    assert figures["median_error_m"] == pytest.approx(0.155)
    assert figures["median_error_deg"] > 5


def test_queries_carry_the_gravity_of_their_poses(service, tmp_path, scan):
    hanging = make_transform(POSE[:3, :3] @ np.diag([1.0, -1.0, -1.0]), POSE[:3, 3])
    rows = [(scan(LOCALIZED), POSE), (scan(OFF), hanging), (scan(FALSE), None)]
    poses = write_poses(tmp_path / "poses.csv", rows)
    asked = ["evaluate", poses, "--map", "hall", "--url", service.url, "--gravity-from-poses"]
    for noise_deg in (0, 3, 3):
        assert ended([*asked, noise_deg]) == 0
    gravity = [query.get("gravity") for query in service.queries]
    assert gravity[2::3] == [None] * 3, "who knows how a scan of another place leaned"
    np.testing.assert_allclose(np.array(gravity[0].split(","), float), [0, 0, -1], atol=1e-9)
    np.testing.assert_allclose(np.array(gravity[1].split(","), float), [0, 0, 1], atol=1e-9)
    assert gravity[3:6] == gravity[6:9], "the noise is the same in every run"
    assert gravity[3] != gravity[0]


@pytest.mark.parametrize("noise_deg", ["-1", "91", "nan"])
def test_no_other_noise_of_gravity(service, poses, capsys, noise_deg):
    asked = ["evaluate", poses, "--map", "hall", "--url", service.url]
    assert ended([*asked, f"--gravity-from-poses={noise_deg}"]) == 2
    assert "noise of gravity" in capsys.readouterr().err
    assert not service.queries


def test_an_evaluation_that_cannot_read_a_scan_names_it(service, poses, tmp_path, capsys):
    (tmp_path / f"{OFF}.npy").unlink()
    assert ended(["evaluate", poses, "--map", "hall", "--url", service.url]) == 2
    assert f"{OFF}.npy: no such file" in capsys.readouterr().err


def test_maps_of_a_service(service, capsys):
    assert ended(["maps", "ls", "--url", service.url]) == 0
    assert capsys.readouterr().out.split() == ["hall", VERSIONS[0]]
    assert ended(["maps", "show", "hall", "--url", service.url]) == 0
    out = capsys.readouterr().out
    assert "12 templates, 2.0 MB, made for a xt32" in out
    assert "10.0 x 20.0 x 3.0 m" in out
    assert ended(["maps", "versions", "hall", "--url", service.url]) == 0
    assert capsys.readouterr().out.startswith(f"* {VERSIONS[0]}  2025-01-02")
    assert ended(["maps", "versions", "hall", "--url", service.url, "--json"]) == 0
    assert [entry["active"] for entry in json.loads(capsys.readouterr().out)["versions"]] == [True, False]
    assert ended(["maps", "show", "yard", "--url", service.url]) == 2


def test_the_environment_names_the_service(service, scan, capsys, monkeypatch):
    monkeypatch.setenv("FIRSTFIX_URL", f"http://127.0.0.1:9,{service.url}")  # replicas, one of which is down
    assert ended(["localize", scan(LOCALIZED), "--map", "hall"]) == 0
    assert ended(["maps", "ls", "--json"]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["maps"][0]["map_id"] == "hall"


def test_evaluate_prints_json_alone(service, poses, capsys):
    assert ended(["evaluate", poses, "--map", "hall", "--url", service.url, "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["n"] == 4


def test_an_activation_is_told_as_json(service, capsys):
    assert ended(["maps", "activate", "hall", "abababab", "--url", service.url, "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said == {"map_id": "hall", "version": VERSIONS[1], "state": "active"}


@pytest.mark.parametrize(
    ("words", "offers"),
    [
        ("firstfix lo", "localize"),
        ("firstfix maps roll", "rollback"),
        ("firstfix localize --odo", "--odometry"),
    ],
)
def test_the_shell_completes(words, offers):
    asked = {"_FIRSTFIX_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
    command = [sys.executable, "-c", AS_INSTALLED]
    done = subprocess.run(command, env={**os.environ, **asked}, capture_output=True, text=True, check=False)
    assert offers in done.stdout.split()


def test_the_completion_can_be_installed(tmp_path):
    """The installed shell script calls ``firstfix`` for completions."""
    command = [sys.executable, "-c", AS_INSTALLED]
    done = subprocess.run(
        [*command, "--install-completion", "bash"],
        env={**os.environ, "HOME": str(tmp_path), "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    script = tmp_path / ".bash_completions" / "firstfix.sh"
    assert "_FIRSTFIX_COMPLETE=complete_bash" in script.read_text()
    assert str(script) in (tmp_path / ".bashrc").read_text()


def test_a_version_is_activated_by_its_first_characters(service, capsys):
    assert ended(["maps", "activate", "hall", "abababab", "--url", service.url]) == 0
    assert service.activated == [VERSIONS[1]]
    for prefix in ("abab", "ffffffff"):
        assert ended(["maps", "activate", "hall", prefix, "--url", service.url]) == 2
    assert service.activated == [VERSIONS[1]]


def test_help_needs_nothing_heavy():
    heavy = {"numpy", "httpx", "scipy", "open3d", "pydantic", "faiss", "matplotlib"}
    code = f"import sys, firstfix_cli.main; print(sorted({heavy} & set(sys.modules)))"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--store", "store", "--executor", "dask://nowhere"], "names no scheduler"),
        (["--store", "store", "--executor", "slurm"], "no executor 'slurm'"),
        (["--store", "memory://", "--executor", "dask://127.0.0.1:8786"], "store in memory"),
        (["--executor", "dask://127.0.0.1:8786"], "--executor needs --store"),
    ],
)
def test_a_build_says_what_is_wrong_with_its_executor(arguments, says, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "map.ply").touch()
    assert ended(["build", "map.ply", "--map-id", "hall", *arguments]) == 2
    assert says in capsys.readouterr().err
