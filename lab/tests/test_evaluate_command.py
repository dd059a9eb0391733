"""``firstfix evaluate``: figures, details, pictures, and the same disturbances for a seed."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from firstfix.transform import make_transform, quaternion_of
from tests.cli.fixtures import FALSE, LOCALIZED, OFF, POSE, REJECTED, ended, scan, service

__all__ = ["scan", "service"]


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


def test_evaluate_prints_json_alone(service, poses, capsys):
    assert ended(["evaluate", poses, "--map", "hall", "--url", service.url, "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["n"] == 4
