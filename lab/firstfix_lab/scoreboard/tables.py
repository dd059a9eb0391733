"""Tables of the pages, each made from the result of one suite."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from tests.recorded_data import DATASETS

from ..common.markdown import table
from ..score.metrics import report_of
from ..score.scored import Scored
from ..suites.ablation.report import HEAD as ABLATION_HEAD
from ..suites.ablation.report import report as ablation_report
from ..suites.paper.report import report as paper_report
from ..suites.peers.report import COLUMNS, all_sets, measured, ranked, wins
from .result import Result
from .scored_cases import AS_IT_IS, GRAVITIES, real_cases, references

PLACES = {  # what the sets are, and the sensor
    "street": ("street, 351 x 526 m", "HDL-64E on a car"),
    "hall": ("hall, 29 x 62 m", "handheld OS0-64"),
    "yard": ("yard, 82 x 245 m", "VLP-16, thinned by its authors"),
    "garage": ("garage, 90 x 24 m", "stop scans"),
    "street_128beam": ("shopping street", "128 beams"),
    "turning": ("room", "Mid-360, turning on the spot"),
}
README_SETS = ("street", "hall", "yard", "street_128beam")  # four sensors; turning judges the heading alone
LEFT_OUT = ("right_first", "area_under_risk_coverage", "median_cpu_s", "p95_cpu_s", "preparation_s")
SHORT_S = 2.0
ROBUST = {
    "answers": "answers",
    "first": "best place within 1 m, 10 deg",
    "within_0.2m_2deg": "best place within 0.2 m, 2 deg",
    "localized": "localized within 1 m, 10 deg",
    "false_accepts": "false accepts",
    "wrong_0.2m": "localized, but over 0.2 m off",
    "ece": "calibration error (ECE)",
}


def readme_rows(result: Result) -> list[str]:
    """A row for each of four places and sensors, and how many scans were localized at a wrong place."""
    sets = [name for name in README_SETS if name in references(result)]
    found = {name: result.figures[name]["variants"][AS_IT_IS]["estimated"] for name in sets}
    head = ("place", "LiDAR", "localized and right, of all scans", "ms a scan, median")
    rows = []
    for name, figures in found.items():
        against = next(iter(figures["against"].values()))
        right = round(against["localized_right"] * figures["n"])
        rows.append((*PLACES[name], f"{right} of {figures['n']}", f"{figures['ms']['p50']:.0f}"))
    wrong, asked = (sum(one[key] for one in found.values()) for key in ("wrong", "n"))
    note = f"Localized, and over 1 m or 10 degrees off: {wrong} of {asked}."
    return [*table(head, rows), "", note]


def real_summary(result: Result) -> list[str]:
    """A row for each set: scans as they are, without gravity, by the first reference."""
    head = ("place", "scans", "best place right", "localized", "false accepts", "median error", "ms a scan")
    rows = []
    for name in references(result):
        figures = result.figures[name]["variants"][AS_IT_IS]["estimated"]
        against = next(iter(figures["against"].values()))
        rows.append(
            (
                _place(name),
                figures["n"],
                round(against["right_first"] * figures["n"]),
                figures["verdicts"]["localized"],
                figures["wrong"],
                _error(against),
                f"{figures['ms']['p50']:.0f}",
            )
        )
    return table(head, rows)


def real_by_reference(result: Result) -> list[str]:
    """A row for each set and reference: scans as they are, without gravity."""
    head = ("set (scans)", "reference", "best place right, share", "localized and right, share")
    head += ("localized / ambiguous / rejected", "false accepts")
    head += ("error in m, median / 95 %", "error in deg, median / 95 %")
    rows = []
    for name, known in references(result).items():
        figures = result.figures[name]["variants"][AS_IT_IS]["estimated"]
        for reference in known:
            against = figures["against"][reference]
            rows.append(
                (
                    f"{name} ({figures['n']})",
                    reference,
                    f"{against['right_first']:.2f}",
                    f"{against['localized_right']:.2f}",
                    " / ".join(map(str, figures["verdicts"].values())),
                    figures["wrong"],
                    _pair(against["error_m"], 3),
                    _pair(against["error_deg"], 2),
                )
            )
    return table(head, rows)


def strangers(result: Result) -> str:
    """A line about the real scans of other places."""
    asked = [result.figures[name]["strangers"] for name in references(result)]
    count, localized = sum(one["n"] for one in asked), sum(len(one["localized"]) for one in asked)
    return f"Road scans of other places: {localized} of {count} localized."


def real_protocol(result: Result) -> list[str]:
    """A row for each set, over all variants, by the benchmark protocol; the last one is given gravity."""

    def cases(name: str, gravity: str) -> list[Scored]:
        return real_cases(result, lambda row: (row["set"], row["gravity"]) == (name, gravity))

    of_sets = {name: cases(name, "estimated") for name in references(result)}
    together = {gravity: [one for name in of_sets for one in cases(name, gravity)] for gravity in GRAVITIES}
    rows = [(name, *_protocol(found)) for name, found in of_sets.items()]
    rows.append(("together", *_protocol(together["estimated"])))
    rows.append(("together, gravity given", *_protocol(together["given"])))
    head = ("set", "answers", "localized within 0.2 m, 1 deg", "localized within 1 m, 5 deg", "false accepts")
    head += ("answered before the first wrong one", "calibration error (ECE)", "s, median / 95 %")
    return table(head, rows)


def real_builds(result: Result) -> list[str]:
    """A row for each set: what the map took."""
    rows = [
        (name, f"{built['build_s']:.0f}", built["build_peak_gb"], f"{built['bytes'] / 1e6:.0f}")
        for name in references(result)
        for built in [result.figures[name]["build"]]
    ]
    return table(("set", "build, s", "peak memory, GB", "version, MB"), rows)


def real_maps(result: Result) -> list[str]:
    """A row for each map: what it is, its templates, and what it took."""
    rows = [
        (
            _place(name),
            built["counts"]["templates"],
            f"{built['bytes'] / 1e6:.0f} MB",
            f"{built['build_s']:.0f} s",
            f"{built['build_peak_gb']} GB",
        )
        for name in references(result)
        for built in [result.figures[name]["build"]]
    ]
    return table(("map", "templates", "version", "build, wall time", "build, peak memory"), rows)


def replica_memory(result: Result) -> list[str]:
    """MiB of a replica by the number of its workers."""
    memory = result.figures["replica_memory"]
    row = (f"MiB, a version of {memory['version_mb']} MB", *memory["mib_by_workers"].values())
    return table(("workers", *memory["mib_by_workers"]), [row])


def peers_table(result: Result) -> list[str]:
    """List the wins of peers, a row for each peer over all sets, the best first, and each set in short."""
    return [*_peers(result), "", *_peers_by_set(result.figures)]


def _peers(result: Result) -> list[str]:
    columns = {key: shown for key, shown in COLUMNS.items() if key not in LEFT_OUT}
    rows = all_sets(result.figures)
    lines = [
        (f"{peer} ({rows[peer]['n']})", *(_short(rows[peer][key]) for key in columns))
        for peer in ranked(rows)
    ]
    return [*wins(result.figures), "", *table(("system (scans)", *columns.values()), lines)]


def _short(value: Any) -> Any:
    """A number as a table of many columns shows it: with three digits, a larger one without fractions."""
    if not isinstance(value, float):
        return value
    return round(value) if abs(value) >= 100 else float(f"{value:.3g}")


def _peers_by_set(figures: Mapping[str, Any]) -> list[str]:
    """A row for each peer, a column for each set: success, false accepts, processor time."""
    of_sets = {name: rows for name, found in figures.items() if (rows := measured(found))}
    head = ["system", *(f"{name} ({len(figures[name]['asked'])})" for name in of_sets)]
    rows = []
    for peer in ranked(all_sets(figures)):
        cells = []
        for found in of_sets.values():
            row = found.get(peer)
            shares = row and f"{row['success_0.2m_1deg']:.2f} / {row['false_accepts']}"
            cells.append(row and f"{shares}, {_short(row['median_cpu_s'])}")
        rows.append((peer, *cells))
    note = "By set: success within 0.2 m, 1 deg / false accepts, median processor seconds."
    return [note, "", *table(head, rows)]


def robust_table(result: Result) -> list[str]:
    """A row for each world, and all of them together. Shares are of scans that no other place explains."""
    worlds = {name: one["bars"] for name, one in result.figures["worlds"].items() if isinstance(one, dict)}
    worlds["together"] = result.figures["bars"]
    return table(
        ("world", *ROBUST.values()),
        [(name, *(_short(bars[key]) for key in ROBUST)) for name, bars in worlds.items()],
    )


def rebuilds_table(result: Result) -> list[str]:
    """A row for each stage, two columns for each change: processor seconds from nothing, and after it.

    Stages that are short everywhere share a row.
    """
    changes = result.figures["changes"]
    sides = [change[side] for change in changes.values() for side in ("full_cpu_s", "rebuild_cpu_s")]
    head = [
        "stage, processor s",
        *(title for name in changes for title in (f"{name}: from nothing", "after it")),
    ]
    stages = dict.fromkeys(stage for side in sides for stage in side)
    short = [stage for stage in stages if max(side.get(stage, 0.0) for side in sides) < SHORT_S]
    rows: list[Sequence[Any]] = [
        (stage, *(side.get(stage, 0.0) for side in sides)) for stage in stages if stage not in short
    ]
    rows.append(("others", *(f"{sum(side.get(stage, 0.0) for stage in short):.1f}" for side in sides)))
    rows.append(("all", *(f"{sum(side.values()):.1f}" for side in sides)))
    rows.append(("ratio", *(one for change in changes.values() for one in (None, change["ratio"]))))
    return table(head, rows)


def service_table(result: Result) -> list[str]:
    """A row for each encoding and transport, and what open consoles cost."""
    by_form: dict[tuple[str, str, int], dict[int, Mapping[str, Any]]] = {}
    for row in result.figures["throughput"]:
        by_form.setdefault((row["encoding"], row["transport"], row["bytes"]), {})[row["clients"]] = row
    counts = sorted({row["clients"] for row in result.figures["throughput"]})
    asking = " / ".join(map(str, counts))
    head = ("encoding", "transport", "bytes", "one client: ms, median / 99 %")
    head += (f"{asking} clients: answers a second",)
    rows = [
        (
            *form,
            _ms(found[counts[0]]),
            " / ".join(f"{found[count]['queries_a_second']:.0f}" for count in counts),
        )
        for form, found in by_form.items()
    ]
    consoles = result.figures["consoles"]
    ratios = consoles["ratio_to_without"].items()
    shown = "; ".join(f"{state} {ratio['p50_ms']} / {ratio['p99_ms']}" for state, ratio in ratios)
    return [
        *table(head, rows),
        "",
        f"{result.figures['templates']} templates. Latency with {consoles['consoles']} open consoles to that "
        f"without, median / 99 %: {shown}.",
    ]


def ablation_table(result: Result) -> list[str]:
    """The table over all sets."""
    lines = ablation_report(result.figures["sets"]).splitlines()
    begin = next(k for k, line in enumerate(lines) if line.startswith(f"| {ABLATION_HEAD[0]}"))
    return [*lines[begin : lines.index("", begin)]]


def paper_tables(result: Result) -> list[str]:
    """All tables of the paper, with ours beside, and where they were measured."""
    on, began = result.machine, result.began[:10]
    where = f"{on['processor']}, Python {result.versions['python']}, load {on['load']} at the beginning"
    return [f"One thread, processor time. {where}, {began}.", "", *paper_report(result.figures).splitlines()]


def ros_table(result: Result) -> list[str]:
    """A row for each distribution, middleware and edge, as the suite prints them."""
    return list(result.figures["lines"])


def skipped_sets(result: Result) -> list[str]:
    """Names of the sets that a suite over data sets did not find, or was not asked for."""
    names = [dataset.name for dataset in DATASETS]
    if not any(name in result.figures for name in names):
        return []
    return [name for name in names if not isinstance(result.figures.get(name), dict)]


def _protocol(cases: Sequence[Scored]) -> list[Any]:
    report = report_of(cases)
    success = [f"{report[key]:.3f}" for key in ("success_0.2m_1deg", "success_1m_5deg")]
    coverage, ece = (f"{report[key]:.3f}" for key in ("coverage_at_risk_0", "ece"))
    seconds = f"{report['time_s_p50']:.3f} / {report['time_s_p95']:.3f}"
    return [report["cases"], *success, report["false_accepts"], coverage, ece, seconds]


def _place(name: str) -> str:
    return ", ".join(PLACES.get(name, (name,)))


def _ms(row: Mapping[str, Any]) -> str:
    return f"{row['p50_ms']} / {row['p99_ms']}"


def _error(against: dict[str, Any]) -> str | None:
    if against["error_m"] is None:
        return None
    return f"{100 * against['error_m']['p50']:.1f} cm, {against['error_deg']['p50']:.2f} deg"


def _pair(percentiles: dict[str, float] | None, digits: int) -> str | None:
    return (
        None if percentiles is None else f"{percentiles['p50']:.{digits}f} / {percentiles['p95']:.{digits}f}"
    )
