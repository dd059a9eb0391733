"""Output and exit codes of the command line."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from firstfix.answer.localization import Localization
from tests.cli.fixtures import AMBIGUOUS, LOCALIZED, REJECTED, ended, moved
from tests.fake_service import VERSIONS

AS_INSTALLED = "import sys; sys.argv[0] = 'firstfix'; from firstfix_cli.main import run; run()"


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


def test_the_old_name_of_a_command_names_the_new_one(capsys):
    assert ended(["samples", "ls", "--store", "there"]) == 2
    assert "firstfix samples is now: firstfix recorded" in capsys.readouterr().err


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


def test_no_service_is_named_with_a_remedy(scan, capsys):
    arguments = ["localize", scan(LOCALIZED), "--map", "hall", "--url", "http://127.0.0.1:9", "--timeout", 1]
    assert ended(arguments) == 1, "it may be there later"
    said = capsys.readouterr().err
    assert said.startswith("firstfix: no answer from http://127.0.0.1:9")
    assert "firstfix serve --store STORE" in said, "the remedy"


@pytest.mark.parametrize("arguments", [[], ["localize"], ["localize", "x.pcd"], ["fly"]])
def test_bad_usage_is_code_2(arguments, capsys):
    assert ended(arguments) == 2


def test_maps_of_a_service(service, capsys):
    assert ended(["maps", "ls", "--url", service.url]) == 0
    header, line = capsys.readouterr().out.splitlines()
    assert header.split("  ")[0] == "MAP"
    assert line.split()[:2] == ["hall", VERSIONS[0][:12]]
    assert ended(["maps", "show", "hall", "--url", service.url]) == 0
    out = capsys.readouterr().out
    assert "12 templates, 2.0 MB, made for xt32" in out
    assert "10.0 x 20.0 x 3.0 m" in out
    assert ended(["maps", "versions", "hall", "--url", service.url]) == 0
    header, active, older = capsys.readouterr().out.splitlines()
    assert active.split()[:4] == ["*", VERSIONS[0][:12], "2025-01-02", "00:00"]
    assert older.split()[0] == VERSIONS[1][:12]
    assert ended(["maps", "versions", "hall", "--url", service.url, "--json"]) == 0
    assert [entry["active"] for entry in json.loads(capsys.readouterr().out)["versions"]] == [True, False]
    assert ended(["maps", "show", "yard", "--url", service.url]) == 2


def test_the_environment_names_the_service(service, scan, capsys, monkeypatch):
    monkeypatch.setenv("FIRSTFIX_URL", f"http://127.0.0.1:9,{service.url}")  # replicas, one of which is down
    assert ended(["localize", scan(LOCALIZED), "--map", "hall"]) == 0
    assert ended(["maps", "ls", "--json"]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["maps"][0]["map_id"] == "hall"


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
    for prefix in ("aba", "ffffffff", "a*"):
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
