"""Pages and pictures made from small results."""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from dataclasses import replace
from typing import Any

import pytest

from firstfix_lab.scoreboard.chart import Axis, chart
from firstfix_lab.scoreboard.pages import (
    benchmark_page,
    large_maps_parts,
    plot_files,
    readme_parts,
    sizing_parts,
)
from firstfix_lab.scoreboard.result import Cases, Result
from firstfix_lab.scoreboard.tables import ROBUST
from firstfix_lab.suites.peers.report import COLUMNS

SVG = "{http://www.w3.org/2000/svg}"
AGAINST = {
    "right_first": 0.5,
    "localized_right": 0.5,
    "error_m": {"p50": 0.031, "p95": 4.0},
    "error_deg": {"p50": 0.25, "p95": 3.0},
}
AS_IT_IS = {
    "n": 2,
    "verdicts": {"localized": 2, "ambiguous": 0, "rejected": 0},
    "wrong": 1,
    "against": {"ICP": AGAINST, "RTK": AGAINST},
    "ms": {"p50": 12.0, "p95": 20.0},
}
REAL = {
    "seed": 1,
    "hall": {
        "build": {"build_s": 50.0, "build_peak_gb": 1.2, "bytes": 27_000_000},
        "variants": {"as it is": {"estimated": AS_IT_IS, "given": AS_IT_IS}},
        "strangers": {"n": 34, "verdicts": {"rejected": 34}, "localized": [], "ms_p50": 90.0},
    },
    "street": "skipped: it is not beside the checkout",
}
COLUMN_NAMES = ["set", "scan", "variant", "gravity", "verdict", "reasons", "probability", "reference"]
ROWS = [
    ["hall", scan, "as it is", gravity, "localized", "", probability, reference, error_m, 0.1, 12.0]
    for scan, probability, error_m in (("a", 0.99, 0.03), ("b", 0.6, 4.0))
    for gravity in ("estimated", "given")
    for reference in ("ICP", "RTK")
]
CASES = Cases([*COLUMN_NAMES, "first_error_m", "first_error_deg", "ms"], ROWS)


def result(suite: str, figures: Any, cases: Cases | None = None) -> Result:
    on = {"cpus": 2, "processor": "a processor", "memory_gb": 24.0, "system": "Debian", "load": 0.1}
    command = f"firstfix-lab {suite}"
    began, python = "2026-11-25T10:00:00+00:00", {"python": "3.11.2"}
    return Result(suite, "a" * 40, {}, command, False, began, 90.0, on, python, figures, cases)


def peer(success: float, seconds: float) -> dict[str, Any]:
    known = {"n": 2, "success_0.2m_1deg": success, "median_cpu_s": seconds}
    rows = [[0.1, 0.5, 7.0, int(success > 0), seconds, seconds, 900]]
    rows.append(
        [0.1, 0.5, 3.0, 1, seconds, seconds, 900]
        if success == 1
        else [None, None, None, 0, seconds, seconds, 900]
    )
    return {**dict.fromkeys(COLUMNS, 0), **known, "answers": rows}


PEERS = {
    "hall": {"asked": ["a", "b"], "firstfix": peer(0.5, 0.02), "other": peer(1.0, 3.0), "gone": "skipped: x"}
}


def test_a_suite_without_a_result_says_so():
    page = benchmark_page({})
    assert page.count("No result") == 9
    assert plot_files({}) == {}
    parts = readme_parts({})
    assert parts == {"real": "No result: `make scoreboard ARGS=real`.\n"}


def test_a_page_shows_what_the_result_holds():
    results = {"real": result("real", REAL, CASES)}
    page, table = benchmark_page(results), readme_parts(results)["real"]
    assert "| hall, 29 x 62 m | handheld OS0-64 | 1 of 2 | 12 |" in table
    assert "over 1 m or 10 degrees off: 1 of 2." in table
    assert "| hall, 29 x 62 m, handheld OS0-64 | 2 | 1 | 2 | 1 | 3.1 cm, 0.25 deg | 12 |" in page
    assert "| `real` | `aaaaaaaa`, 2026-11-25 | 2 min | 0.1 |" in page
    assert table.endswith("\n\nMeasured at `aaaaaaaa`, 2026-11-25.\n")
    assert "Not there, or not in this run: street, yard, garage" in page
    assert "| together | 2 | 0.500 | 0.500 | 1 | 0.500 |" in page


def test_a_changed_number_changes_the_page():
    changed = copy.deepcopy(REAL)
    changed["hall"]["variants"]["as it is"]["estimated"]["wrong"] = 0  # type: ignore[index]
    before, after = result("real", REAL, CASES), result("real", changed, CASES)
    assert readme_parts({"real": before}) != readme_parts({"real": after})
    rows = [[*row[:8], 0.02, *row[9:]] for row in ROWS]
    better = replace(before, cases=Cases(CASES.columns, rows))
    assert benchmark_page({"real": before}) != benchmark_page({"real": better})


def test_the_peer_that_wins_stands_first():
    page = benchmark_page({"peers": result("peers", PEERS)})
    assert "\n**Where another system wins:**\n" in page
    assert "success within 0.2 m and 1 deg: other 1.0 against 0.5" in page
    assert page.index("| other (2) |") < page.index("| firstfix (2) |")
    assert "| other | 1.00 / 0, 3.0 |" in page
    assert "gone" not in page


def test_a_rebuild_is_shown_by_stage_and_as_a_ratio():
    change = {
        "full_cpu_s": {"read_map": 4.0, "self_test": 6.0},
        "rebuild_cpu_s": {"read_map": 2.0},
        "ratio": 0.2,
    }
    other = {"full_cpu_s": {"read_map": 3.0}, "rebuild_cpu_s": {"read_map": 1.5}, "ratio": 0.5}
    changes = {"one aisle": change, "a house": other}
    page = benchmark_page({"rebuilds": result("rebuilds", {"changes": changes})})
    assert (
        "| stage, processor s | one aisle: from nothing | after it | a house: from nothing | after it |"
        in page
    )
    assert "| self_test | 6.0 | 0.0 | 0.0 | 0.0 |" in page
    assert "| all | 10.0 | 2.0 | 3.0 | 1.5 |" in page
    assert "| ratio | - | 0.2 | - | 0.5 |" in page


def test_the_service_has_a_row_for_each_form():
    def row(clients: int, rate: float) -> dict[str, Any]:
        about = {"transport": "http", "encoding": "scan", "bytes": 900, "clients": clients}
        return {**about, "queries_a_second": rate, "p50_ms": 9.5, "p95_ms": 11.0, "p99_ms": 12.5}

    ratios = {"elsewhere": {"p50_ms": 1.0, "p99_ms": 1.1}, "with": {"p50_ms": 1.02, "p99_ms": 1.25}}
    figures = {"templates": 700, "throughput": [row(1, 99.6), row(4, 180.2)]}
    figures["consoles"] = {"consoles": 10, "ratio_to_without": ratios}
    page = benchmark_page({"service": result("service", figures)})
    assert "| one client: ms, median / 99 % | 1 / 4 clients: answers a second |" in page
    assert "| scan | http | 900 | 9.5 / 12.5 | 100 / 180 |" in page
    assert "10 open consoles to that without, median / 99 %: elsewhere 1.0 / 1.1; with 1.02 / 1.25." in page


def test_a_suite_that_was_gone_on_with_took_as_long_as_its_parts():
    bars = dict.fromkeys(ROBUST, 1)
    worlds = {name: {"bars": bars, "seconds": 1800.0} for name in ("hall", "yard")}
    page = benchmark_page(
        {"robust": result("robust", {"worlds": {**worlds, "gone": "skipped: x"}, "bars": bars})}
    )
    assert "| `aaaaaaaa`, 2026-11-25 | 60 min in parts | 0.1 |" in page


def test_sizes_of_maps_and_replicas():
    memory = {"version_mb": 346.9, "mib_by_workers": {"1": 451, "2": 504}}
    real = copy.deepcopy(REAL)
    real["hall"]["build"] = {
        "counts": {"templates": 649},
        "bytes": 34_405_884,
        "build_s": 43.7,
        "build_peak_gb": 0.51,
    }  # type: ignore[index]
    parts = sizing_parts(
        {"real": result("real", real, CASES), "service": result("service", {"replica_memory": memory})}
    )
    assert "| hall, 29 x 62 m, handheld OS0-64 | 649 | 34 MB | 44 s | 0.51 GB |" in parts["real"]
    assert "| workers | 1 | 2 |" in parts["service"]
    assert "| MiB, a version of 346.9 MB | 451 | 504 |" in parts["service"]


def test_a_second_machine_is_told_with_its_suites():
    scale = result("scale", {"worlds": {}})
    rebuilds = result("rebuilds", {"changes": {}})
    same = benchmark_page({"scale": scale, "rebuilds": rebuilds})
    assert same.count("2 cores (a processor), 24.0 GB, Debian, Python 3.11.2.") == 1
    other = replace(scale, machine={**scale.machine, "cpus": 8})
    page = benchmark_page({"scale": other, "rebuilds": rebuilds})
    assert "* 8 cores (a processor), 24.0 GB, Debian, Python 3.11.2: `scale`\n" in page
    assert "* 2 cores (a processor), 24.0 GB, Debian, Python 3.11.2: `rebuilds`\n" in page


def test_scale_has_a_column_for_each_world():
    cost = {"seconds": 2.0, "cpu_seconds": 3.4, "peak_own_mb": 900}
    stages = (
        "reconstruct_mesh",
        "make_templates",
        "learn_keys",
        "carve_free_space",
        "build_index",
        "self_test",
    )
    memory = {"own": 100, "resident": 300}
    asked = {"median_ms": 12.0, "p99_ms": 19.5, "success": {"0.05m": 1.0, "0.2m": 1.0}, "false": 0}
    asked |= {"localized": 0.99, "stages_ms": {"preprocess": 4.01, "search": 3.02, "register": 5.03}}
    world = {
        "templates": 1000,
        "extent_m": [80, 80],
        "version_mb": 9.5,
        "load_ms": 7.0,
        "first_query_ms": 60.0,
    }
    world |= {"loaded": memory, "after_queries": memory, "anywhere": asked, "with_prior": asked}
    world |= {"build": dict.fromkeys(stages, cost), "build_s": 12.0, "build_cpu_s": 20.4}
    exact, quick = {"true_among_400": 1.0}, {"search_ms": 0.151, "true_among_400": 0.975}
    world["keys"] = {"exact": exact, "faiss_ivf_sq8": quick}
    larger = {**world, "templates": 9000, "keys": {"exact": exact}}
    results = {"scale": result("scale", {"worlds": {"30k": world, "1M": larger}})}
    text = large_maps_parts(results)["scale"]
    assert "| templates | 1000 | 9000 |" in text
    assert "| query, p50 / p99, ms | 12.0 / 19.5 | 12.0 / 19.5 |" in text
    assert "| ... of it preprocessing / search / registration | 4.0 / 3.0 / 5.0 |" in text
    assert "| ... surface, keys, free space, index, processor s | 14 | 14 |" in text
    assert "GB | 0.9 (reconstruct_mesh) |" in text
    assert "| faiss_ivf_sq8 | 0.15, 0.975 | - |" in text
    assert "| 30k | 1000 | 12.0 / 19.5 | 1.0 | 0 | 9.5 | 20.4 |" in benchmark_page(results)


@pytest.mark.parametrize("names", [("real",), ("real", "peers"), ("scale",)], ids="+".join)
def test_pictures_are_well_formed_and_show_their_data(names):
    world = {"templates": 1000, "anywhere": {"median_ms": 10.0, "p99_ms": 20.0}}
    figures: dict[str, Any] = {"real": REAL, "peers": PEERS, "scale": {"worlds": {"a": world, "b": world}}}
    found = plot_files(
        {name: result(name, figures[name], CASES if name == "real" else None) for name in names}
    )
    expected = {
        "real": {"success.svg", "risk.svg", "reliability.svg"},
        "peers": {"peers.svg", "peers_risk.svg"},
        "scale": {"size.svg"},
    }
    assert set(found) == set().union(*(expected[name] for name in names))
    for text in found.values():
        root = ET.fromstring(text)
        assert root.findall(f"{SVG}circle")
        assert root.find(f"{SVG}rect").get("fill") == "#fff"  # type: ignore[union-attr]


def test_a_point_stands_where_the_axes_say():
    x, y = Axis("a < b", 1.0, 100.0, log=True), Axis("share", 0.0, 1.0)
    root = ET.fromstring(chart("T", x, y, {"line": [(1.0, 0.0), (10.0, 0.5), (100.0, 1.0)]}, {}))
    across = [float(dot.get("cx", "")) for dot in root.findall(f"{SVG}circle")]
    down = [float(dot.get("cy", "")) for dot in root.findall(f"{SVG}circle")]
    assert across[1] == pytest.approx((across[0] + across[2]) / 2)
    assert down[0] > down[1] > down[2]
    assert "a < b" in [text.text for text in root.findall(f"{SVG}text")]
    assert x.ticks() == [1, 2, 5, 10, 20, 50, 100]
