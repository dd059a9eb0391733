"""Results of the scoreboard and the pages made from them: neither is older than the code."""

import re
from pathlib import Path

import pytest

from benchmarks.scoreboard.result import MOST_BYTES, Result
from benchmarks.scoreboard.run import is_old
from benchmarks.scoreboard.suites import SUITES

REPO = Path(__file__).resolve().parents[2]
RESULTS = REPO / "benchmarks" / "results"
MOST_PAGE_BYTES = 12_000
HASH = re.compile(r"\bcommit [0-9a-f]{7,}|`[0-9a-f]{7,40}`")


@pytest.mark.parametrize("name", SUITES)
def test_no_result_is_older_than_the_code_that_it_measures(name: str):
    if not (REPO / ".git").exists():
        pytest.skip("needs a git checkout, which knows what belongs to it: git clone")
    result = Result.load(RESULTS, name)
    if result is not None:
        old = is_old(result, SUITES[name], REPO)
        assert not old, f"`make scoreboard ARGS={name}`, or `python -m benchmarks.scoreboard --remove-old`"
        assert not result.quick


def test_every_result_belongs_to_a_suite_and_is_small():
    for path in RESULTS.glob("*"):
        assert path.name.removesuffix(".json").removesuffix(".csv.gz") in SUITES
        assert path.stat().st_size <= MOST_BYTES


def test_every_picture_belongs_to_a_page():
    page = (REPO / "benchmarks" / "BENCHMARK.md").read_text()
    assert not [path.name for path in (REPO / "benchmarks" / "plots").glob("*") if path.name not in page]


def test_the_page_of_figures_is_short_and_the_readme_names_no_commit():
    assert (REPO / "benchmarks" / "BENCHMARK.md").stat().st_size <= MOST_PAGE_BYTES
    assert not HASH.findall((REPO / "README.md").read_text())
    assert HASH.findall("Hall and street are of commit 7e62fdc.")
