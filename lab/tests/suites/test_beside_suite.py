"""The suite that asks two checkouts in turns, small: this checkout beside itself."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firstfix_lab.checkout import ROOT
from firstfix_lab.common.processor_time import cpu_s_of_family
from firstfix_lab.suites.beside.agreement import agreement
from firstfix_lab.suites.beside.build import Built, Source
from firstfix_lab.suites.beside.places import DEMO, RECORDED, bodies_of
from firstfix_lab.suites.beside.run_build import StageCosts
from firstfix_lab.suites.beside.suite import PARTS, asked, build_costs, shares_of
from firstfix_lab.suites.beside.tree import Tree
from firstfix_lab.suites.beside.worker import CannotLoad, Worker

TREES = [Tree("this", ROOT), Tree("beside", ROOT)]


def answer(x_m: float | None, probability: float = 1.0, verdict: str = "localized", *reasons: str) -> Any:
    pose = None if x_m is None else np.eye(4)
    if pose is not None:
        pose[0, 3] = x_m
    return {
        "cpu_ms": 1.0,
        "verdict": verdict,
        "reasons": list(reasons),
        "T_map_sensor": None if pose is None else pose.tolist(),
        "probability": probability,
    }


def test_answers_are_compared_pair_by_pair():
    here = [answer(1.0), answer(1.002, 0.9), answer(None, 0.1, "rejected", "low_inlier_ratio")]
    there = [answer(1.0), answer(1.0), answer(None, 0.1, "rejected", "low_inlier_ratio")]
    found = agreement(here, there)
    assert found["same_verdict_and_reasons"] == 3
    assert found["both_localized"] == 2
    assert found["apart_median_mm"] == pytest.approx(1.0)
    assert found["apart_max_mm"] == pytest.approx(2.0)
    assert found["probability_apart_max"] == pytest.approx(0.1)
    worse = agreement(here, [*there[:2], answer(1.0)])
    assert worse["same_verdict_and_reasons"] == 2
    assert worse["other_outcomes"] == ["localized -> rejected/low_inlier_ratio"]


def test_easy_scans_have_a_share_of_their_own():
    here = [answer(1.0), answer(1.0), answer(None, 0.1, "rejected", "low_probability")]
    there = [answer(1.0), answer(1.0), answer(None, 0.1, "ambiguous", "several_places")]
    found = shares_of([here, there], [[6.0, 4.0, 50.0], [10.0, 10.0, 80.0]])
    assert found == {"easy": 2, "mean": 0.6, "easy_median": 0.5}
    assert shares_of([here[2:], there[2:]], [[50.0], [80.0]]) == {"easy": 0, "mean": 0.625}


def test_the_demo_and_every_recorded_place_can_be_asked():
    assert {DEMO, "hall", "yard", "street", "street_128beam"} <= set(PARTS)
    assert {dataset.name for dataset in RECORDED.values()} == set(RECORDED)


def test_a_stage_costs_what_was_spent_until_its_last_report():
    spent = iter([0.0, 1.0, 3.0, 4.0, 10.0, 11.5])
    costs = StageCosts(lambda: next(spent))
    for stage, fraction in (("a", 0.0), ("a", 0.5), ("a", 1.0), ("a", 1.0), ("b", 0.0), ("b", 1.0)):
        costs(stage, fraction)
    assert costs.cpu_s == {"a": 4.0, "b": 1.5}


WORK = "sum(range(3_000_000)); print('worked', flush=True)"
RUN_CHILD = "import subprocess, sys; subprocess.run([sys.executable, '-c', sys.argv[1]])"


@pytest.mark.parametrize("child", [f"{WORK}; input()", WORK], ids=["runs", "ended"])
def test_the_processor_time_of_a_child_counts(child: str):
    own = f"{RUN_CHILD}; print('done', flush=True); input()"
    with subprocess.Popen(
        [sys.executable, "-c", own, child], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as parent:
        assert parent.stdout is not None
        parent.stdout.readline()  # the child has worked
        if child == WORK:
            parent.stdout.readline()  # and was waited for
        assert cpu_s_of_family(parent.pid) > _own_cpu_s(parent.pid)
        parent.communicate(b"\n\n")
    assert cpu_s_of_family(parent.pid) == 0.0  # it is gone


def _own_cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return sum(map(int, fields[11:13])) / os.sysconf("SC_CLK_TCK")


def test_a_build_is_kept_by_its_code_and_all_that_it_reads(tmp_path: Path):
    for name, text in (("map.ply", "map"), ("other.ply", "other"), ("path.csv", "path")):
        (tmp_path / name).write_text(text)
    source = Source(tmp_path / "map.ply", tmp_path / "path.csv", {"sensor": "os1-64"})
    others = [
        Source(tmp_path / "other.ply", source.trajectory, source.config),
        Source(source.map, None, source.config),
        Source(source.map, source.trajectory, {"sensor": "os0-64"}),
    ]
    assert len({one.digest() for one in (source, *others)}) == 4
    for tree, text in (("one", "x = 1"), ("two", "x = 2")):
        (tmp_path / tree / "core").mkdir(parents=True)
        (tmp_path / tree / "core" / "a.py").write_text(text)
    assert Tree("one", tmp_path / "one").code_digest() != Tree("two", tmp_path / "two").code_digest()


@pytest.mark.slow
def test_a_checkout_beside_itself_answers_the_same(small_version, small_scans, tmp_path: Path):
    version = small_version.directory
    bodies = bodies_of([scan for scan, _ in small_scans[:3]], version)
    figures = asked([(tree, version) for tree in TREES], bodies, rounds=2)
    assert figures["templates"]["this"] == figures["templates"]["beside"] > 100
    for form in ("raw", "compact"):
        found = figures[form]
        for cost in ("cpu_ms_median", "cpu_ms_p95"):
            assert all(found[cost][name] > 0 for name in ("this", "beside", "ratio"))
        agreed = found["agreement"]
        assert agreed["answers"] == agreed["same_verdict_and_reasons"] == 3
        assert agreed["both_localized"] >= 1
        assert agreed["apart_max_mm"] == agreed["probability_apart_max"] == 0.0
    with pytest.raises(CannotLoad, match="nothing"):
        Worker(TREES[0], tmp_path / "nothing")


def test_costs_of_builds_are_grouped_and_compared():
    versions = [
        Built(Path(), {"make_templates": 2.0, "learn_keys": 1.0, "read_map": 1.0, "a_new_stage": 1.0}),
        Built(Path(), {"make_templates": 5.0, "learn_keys": 1.0, "read_map": 1.0}),
    ]
    found = build_costs(TREES, versions)
    assert found["templates"] == {"this": 2.0, "beside": 5.0, "ratio": 2.5}
    assert found["all_others"] == {"this": 2.0, "beside": 1.0, "ratio": 0.5}
    assert found["self_test"] == {"this": 0.0, "beside": 0.0}
    assert found["all"] == {"this": 5.0, "beside": 7.0, "ratio": 1.4}
