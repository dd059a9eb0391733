"""Results of the scoreboard, and the pages made from them, which say of when they are."""

import re
import subprocess
import sys
from datetime import datetime
from pathlib import Path

import pytest

from firstfix_lab.scoreboard.result import MAX_BYTES, Result
from firstfix_lab.scoreboard.suites import SUITES

REPO = Path(__file__).resolve().parents[2]
RESULTS = REPO / "lab" / "results"
MAX_PAGE_BYTES = 14_000
PAGES = ("README.md", "lab/PAPER.md", "docs/how-to/deploy.md", "lab/docs/large-maps.md")
PART = re.compile(r"<!-- figures: (?P<suite>\w+) -->\n(?P<text>.*?)\n<!-- end of figures -->", re.S)
HASH = re.compile(r"\bcommit [0-9a-f]{7,}|`[0-9a-f]{7,40}`")


@pytest.mark.parametrize("name", [name for name in SUITES if (RESULTS / f"{name}.json").exists()])
def test_a_result_says_commit_and_date_and_so_does_every_page_with_it(name: str):
    result = Result.load(RESULTS, name)
    assert result is not None
    assert not result.quick
    assert re.fullmatch(r"[0-9a-f]{40}", result.commit)
    datetime.fromisoformat(result.began)
    pages = [(REPO / page).read_text() for page in PAGES]
    assert f"| `{name}` | {result.measured_at} |" in (REPO / "lab" / "BENCHMARK.md").read_text()
    for page in pages:
        for part in PART.finditer(page):
            if part["suite"] == name:
                assert part["text"].endswith(f"\nMeasured at {result.measured_at}.\n")


def test_the_check_of_results_fails_nothing():
    if not (REPO / ".git").exists():
        pytest.skip("needs a git checkout, which knows what belongs to it: git clone")
    command = [sys.executable, "-m", "firstfix_lab", "scoreboard", "--check"]
    done = subprocess.run(command, cwd=REPO, capture_output=True, text=True, check=True)
    *lines, together = done.stdout.splitlines()
    assert [line.partition(":")[0] for line in lines] == list(SUITES)
    assert "older than the code, to measure them again: " in together


def test_every_result_belongs_to_a_suite_and_is_small():
    for path in RESULTS.glob("*"):
        assert path.name.removesuffix(".json").removesuffix(".csv.gz") in SUITES
        assert path.stat().st_size <= MAX_BYTES


def test_every_picture_belongs_to_a_page():
    page = (REPO / "lab" / "BENCHMARK.md").read_text()
    assert not [path.name for path in (REPO / "lab" / "plots").glob("*") if path.name not in page]


def test_the_page_of_figures_is_short():
    assert (REPO / "lab" / "BENCHMARK.md").stat().st_size <= MAX_PAGE_BYTES


def test_the_readme_names_no_commit_by_hand():
    """Commits are named by generated text alone, so that they are those of the results that are shown."""
    by_hand = PART.sub("", (REPO / "README.md").read_text())
    assert "Measured at" not in by_hand
    assert not HASH.findall(by_hand)
    assert HASH.findall("Hall and street are of commit 7e62fdc.")
