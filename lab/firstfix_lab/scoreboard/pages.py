"""Parts of pages that are made from results: BENCHMARK.md, tables of other pages, and pictures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from ..common.markdown import table
from . import scale_tables, tables
from .plots import pictures
from .result import Result
from .suites import SUITES

Results = Mapping[str, Result]
TITLES = {
    "real": "Real maps and held-out scans",
    "peers": "Other systems",
    "robust": "Simulated worlds: everything that goes wrong with a scan",
    "service": "The service",
    "scale": "Scale",
    "rebuilds": "A build after a part of the map has changed",
    "ablation": "Each part taken out alone",
    "paper": "The paper's tables",
    "ros": "ROS distributions and middlewares",
}
PLOTS = {
    "real": ("success.svg", "risk.svg", "reliability.svg"),
    "peers": ("peers.svg", "peers_risk.svg"),
    "scale": ("size.svg",),
}
TABLES: dict[str, Callable[[Result], list[str]]] = {
    "peers": tables.peers_table,
    "robust": tables.robust_table,
    "service": tables.service_table,
    "scale": scale_tables.summary,
    "rebuilds": tables.rebuilds_table,
    "ablation": tables.ablation_table,
    "ros": tables.ros_table,
}


def load(folder: Path) -> dict[str, Result]:
    """The results of whole runs by the suite's name."""
    found = {name: Result.load(folder, name) for name in SUITES}
    return {name: result for name, result in found.items() if result is not None and not result.quick}


def plot_files(results: Results) -> dict[str, str]:
    """The pictures by their names."""
    return pictures(results)


def benchmark_page(results: Results) -> str:
    """The generated part of BENCHMARK.md."""
    lines = ["## What was measured", "", *_overview(results), "", *_machines(results), ""]
    for name, title in TITLES.items():
        if name in results and name != "paper":  # it has a page of its own
            lines += [f"## {title} (`{name}`)", "", *_section(name, results[name]), ""]
            lines += [f"![{plot.removesuffix('.svg')}](plots/{plot})" for plot in PLOTS.get(name, ())]
            lines += [""] if name in PLOTS else []
    return "\n".join(lines)


def readme_parts(results: Results) -> dict[str, str]:
    """The table of the README by the name of its marker."""
    return {"real": _part("real", results, tables.readme_rows)}


def large_maps_parts(results: Results) -> dict[str, str]:
    """The tables of lab/docs/large-maps.md by the name of their marker."""
    return {"scale": _part("scale", results, scale_tables.whole)}


def sizing_parts(results: Results) -> dict[str, str]:
    """The tables of docs/how-to/deploy.md by the name of their marker."""
    return {
        "real": _part("real", results, tables.real_maps),
        "service": _part("service", results, tables.replica_memory),
    }


def paper_parts(results: Results) -> dict[str, str]:
    """The tables of PAPER.md by the name of their marker."""
    return {"paper": _part("paper", results, tables.paper_tables)}


def _part(name: str, results: Results, maker: Callable[[Result], list[str]]) -> str:
    if name not in results:
        return f"No result: `make scoreboard ARGS={name}`.\n"
    found = results[name]
    return "\n".join([*maker(found), "", f"Measured at {found.measured_at}."]) + "\n"


def _overview(results: Results) -> list[str]:
    rows = []
    for name in TITLES:
        found = results.get(name)
        if found is None:
            rows.append((f"`{name}`", "No result", None, None))
            continue
        rows.append((f"`{name}`", found.measured_at, _took(found), found.machine["load"]))
    return table(("suite", "measured at", "took", "load at the beginning"), rows)


def _took(result: Result) -> str:
    """Minutes that a suite took. Of one that goes on where it was interrupted: of its processes together."""
    return f"{result.run_s / 60:.0f} min{' in parts' if result.parts_s else ''}"


def _machines(results: Results) -> list[str]:
    """A line for each machine, with its suites if there are several."""
    suites: dict[str, list[str]] = {}
    for name in TITLES:
        if name in results:
            suites.setdefault(_machine(results[name]), []).append(f"`{name}`")
    if len(suites) == 1:
        return [f"{machine}." for machine in suites]
    return [f"* {machine}: {', '.join(names)}" for machine, names in suites.items()]


def _machine(result: Result) -> str:
    on = result.machine
    cores = f"{on['cpus']} cores ({on['processor']}), {on['memory_gb']} GB"
    return f"{cores}, {on['system']}, Python {result.versions['python']}"


def _section(name: str, result: Result) -> list[str]:
    lines = []
    if missing := tables.skipped_sets(result):
        lines += [f"Not there, or not in this run: {', '.join(missing)}.", ""]
    if name == "real":
        return lines + _real(result)
    return lines + TABLES[name](result)


def _real(result: Result) -> list[str]:
    return [
        "Scans as they are, against the first reference, and against each:",
        "",
        *tables.real_summary(result),
        "",
        *tables.real_by_reference(result),
        "",
        tables.strangers(result),
        "",
        "All variants against the first reference, by the protocol:",
        "",
        *tables.real_protocol(result),
        "",
        *tables.real_builds(result),
    ]
