"""The scoreboard over a small repository with a suite of its own: what is measured, left out and refused."""

from __future__ import annotations

import gzip
import json
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from firstfix_lab.checkout import ROOT
from firstfix_lab.scoreboard.check import check
from firstfix_lab.scoreboard.result import Cases, Result, ResultTooLarge, UnreadableResult
from firstfix_lab.scoreboard.run import NotOneCommit, is_old, run
from firstfix_lab.scoreboard.suites import SUITES, Suite
from firstfix_lab.scoreboard.tree import object_ids

PROGRAM = """\
import json, pathlib, sys
runs = pathlib.Path("build/runs")
runs.parent.mkdir(exist_ok=True)
runs.write_text(runs.read_text() + "x" if runs.exists() else "x")
pathlib.Path("build/cases.csv").write_text("scan,error_m\\na,0.25\\nb,inf\\n")
figures = {"seed": 3, "hall": {"n": 2}, "street": "skipped: it is not here", "arguments": sys.argv[1:-2]}
pathlib.Path(sys.argv[-1]).write_text(json.dumps(figures))
"""
SUITE = Suite("small", ("whole",), ("part",), ("small.py", "room"), "build/cases.csv", module="small")


@pytest.fixture
def repo(tmp_path: Path) -> Path:
    repo = tmp_path / "repo"
    (repo / "room").mkdir(parents=True)
    (repo / "small.py").write_text(PROGRAM)
    (repo / "room" / "part.py").write_text("HEIGHT_M = 1.0\n")
    (repo / "README.md").write_text("A page.\n")
    (repo / ".gitignore").write_text("build/\n__pycache__/\n")
    git(repo, "init", "-q")
    commit(repo)
    return repo


def git(repo: Path, *arguments: str) -> None:
    named = ["-c", "user.name=a", "-c", "user.email=a@example.org", "-c", "commit.gpgsign=false"]
    subprocess.run(["git", "-C", str(repo), *named, *arguments], check=True)


def commit(repo: Path) -> None:
    git(repo, "add", "-A")
    git(repo, "commit", "-q", "-m", "a state")


def measure(repo: Path, results: Path, quick: bool = False) -> str:
    return run([SUITE], repo, results, quick=quick, say=lambda line: None)["small"]


def test_a_result_has_all_that_is_needed_to_judge_it(repo: Path, tmp_path: Path):
    said = measure(repo, tmp_path)
    assert "; street skipped: it is not here" in said
    found = Result.load(tmp_path, "small")
    assert found is not None
    assert found.command == "firstfix-lab whole"
    assert found.figures["seed"] == 3
    assert found.cases == Cases(["scan", "error_m"], [["a", 0.25], ["b", None]])
    assert set(found.measured) == {"small.py", "room"}
    assert all(len(each) == 40 for each in (found.commit, *found.measured.values()))
    assert found.machine["cpus"] >= 1
    assert "numpy" in found.versions
    assert json.loads((tmp_path / "small.json").read_text())["figures"]["seed"] == 3
    table = gzip.decompress((tmp_path / "small.csv.gz").read_bytes())  # as another program reads it
    assert table == b"scan,error_m\na,0.25\nb,nan\n"


def test_only_what_has_changed_is_measured_again(repo: Path, tmp_path: Path):
    runs = repo / "build" / "runs"
    measure(repo, tmp_path)
    (repo / "README.md").write_text("Another page.\n")
    commit(repo)
    assert measure(repo, tmp_path).startswith("left out")
    assert runs.read_text() == "x"
    (repo / "room" / "part.py").write_text("HEIGHT_M = 2.0\n")
    commit(repo)
    result = Result.load(tmp_path, "small")
    assert result is not None
    assert is_old(result, SUITE, repo) == ["room"]
    assert measure(repo, tmp_path).startswith("measured")
    assert runs.read_text() == "xx"


def test_a_result_is_compared_in_a_clone_without_its_history(repo: Path, tmp_path: Path):
    measure(repo, tmp_path)
    (repo / "README.md").write_text("Another page.\n")
    commit(repo)
    subprocess.run(
        ["git", "clone", "-q", "--depth", "1", f"file://{repo}", str(tmp_path / "clone")], check=True
    )
    result = Result.load(tmp_path, "small")
    assert result is not None
    assert is_old(result, SUITE, tmp_path / "clone") == []


def test_a_result_without_a_path_that_counts_by_now_is_old(repo: Path, tmp_path: Path):
    measure(repo, tmp_path)
    result = Result.load(tmp_path, "small")
    assert result is not None
    wider = Suite("small", (), None, (*SUITE.measured, "README.md"), module="small")
    assert is_old(result, wider, repo) == ["README.md"]


def test_the_check_tells_what_is_older_by_how_much_and_how_long_it_takes(repo: Path, tmp_path: Path):
    assert check([SUITE], repo, tmp_path) == [
        "small: no result",
        "0 older than the code, to measure them again: 0 min",
    ]
    measure(repo, tmp_path)
    result = Result.load(tmp_path, "small")
    assert result is not None
    replace(result, seconds=600.0).save(tmp_path)
    at = f"`{result.commit[:8]}`, {result.began[:10]}"
    assert check([SUITE], repo, tmp_path)[0] == f"small: measured at {at}, of the present code"
    for number in range(3):
        (repo / "room" / "part.py").write_text(f"HEIGHT_M = {number}\n")
        commit(repo)
        (repo / "README.md").write_text(f"Page {number}.\n")
        commit(repo)
    assert check([SUITE], repo, tmp_path) == [
        f"small: measured at {at}, 3 commits older than the code (room): 10 min",
        "1 older than the code, to measure them again: 10 min",
    ]
    clone = tmp_path / "clone"
    subprocess.run(["git", "clone", "-q", "--depth", "1", f"file://{repo}", str(clone)], check=True)
    assert (
        "older than the code by commits that this clone does not have (room): 10 min"
        in (check([SUITE], clone, tmp_path)[0])
    )


@pytest.mark.parametrize("stored", ['{"suite": "small", "cases": []}', '{"suite"', "[1, 2]", "\xff"])
def test_a_result_of_another_form_is_measured_anew(repo: Path, tmp_path: Path, stored: str):
    file = tmp_path / "small.json"
    file.write_bytes(stored.encode("latin-1"))
    with pytest.raises(UnreadableResult, match=r"^small\.json: "):
        Result.load(tmp_path, "small")
    assert measure(repo, tmp_path).startswith("measured")
    file.write_bytes(stored.encode("latin-1"))
    assert check([SUITE], repo, tmp_path)[0].startswith("small: its result cannot be read: small.json: ")
    measure(repo, tmp_path)
    (tmp_path / "small.csv.gz").write_bytes(b"no archive")
    assert measure(repo, tmp_path).startswith("measured")


def test_a_work_tree_with_changes_is_refused_but_for_a_quick_run(repo: Path, tmp_path: Path):
    (repo / "new.py").write_text("")
    with pytest.raises(NotOneCommit, match=r"new\.py"):
        measure(repo, tmp_path)
    assert measure(repo, tmp_path, quick=True).startswith("measured")
    result = Result.load(tmp_path, "small")
    assert result is not None
    assert result.quick
    assert result.figures["arguments"] == ["part"]


def test_code_that_changes_meanwhile_gives_no_result(repo: Path, tmp_path: Path):
    (repo / "small.py").write_text(PROGRAM + 'pathlib.Path("room/part.py").write_text("")\n')
    commit(repo)
    assert measure(repo, tmp_path) == "failed: its code was changed meanwhile: room/part.py"
    assert Result.load(tmp_path, "small") is None


def test_a_suite_that_ends_badly_gives_no_result(repo: Path, tmp_path: Path):
    (repo / "small.py").write_text("raise SystemExit(3)\n")
    commit(repo)
    assert measure(repo, tmp_path) == "failed: the suite ended with 3, see above"
    assert Result.load(tmp_path, "small") is None


def test_a_result_that_is_too_large_is_not_written(tmp_path: Path):
    cases = Cases(["scan"], [[float(value)] for value in np.random.default_rng(1).random(60_000)])
    result = Result("large", "0" * 40, {}, "", False, "", 1.0, {}, {}, {}, cases)
    with pytest.raises(ResultTooLarge, match=r"large.csv.gz: \d+ bytes, at most 400000"):
        result.save(tmp_path)
    assert not (tmp_path / "large.json").exists()


@pytest.mark.parametrize("suite", SUITES.values(), ids=lambda suite: suite.name)
def test_every_measured_path_is_there(suite: Suite):
    ids = object_ids(ROOT, suite.measured)
    assert not [path for path, found in ids.items() if not found]
