"""The pictures of the scoreboard, each made from one or two results."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..score.metrics import reliability, report_of, risk_coverage, success_rate
from ..score.scored import Scored
from .chart import Axis, Points, chart
from .result import Result
from .scored_cases import AS_IT_IS, GRAVITIES, peer_cases, real_cases, references

LIMITS_M = tuple(float(limit) for limit in np.geomspace(0.01, 2.0, 24))
SUCCESS_DEG = 5.0


def pictures(results: Mapping[str, Result]) -> dict[str, str]:
    """The SVG files by their names, those whose results are there."""
    found = {}
    if real := results.get("real"):
        found["success.svg"] = success_picture(real)
        found["risk.svg"] = risk_picture(real)
        found["reliability.svg"] = reliability_picture(real)
    if peers := results.get("peers"):
        found["peers.svg"] = peers_picture(peers)
        found["peers_risk.svg"] = peers_risk_picture(peers)
    if scale := results.get("scale"):
        found["size.svg"] = size_picture(scale)
    return found


def success_picture(real: Result) -> str:
    """Success of the scans as they are, without gravity, against the error that is allowed."""
    lines: dict[str, Points] = {}
    for name in references(real):
        cases = real_cases(
            real,
            lambda row, name=name: (
                (row["set"], row["variant"], row["gravity"]) == (name, AS_IT_IS, "estimated")
            ),
        )
        lines[f"{name} ({len(cases)})"] = [
            (limit, success_rate(cases, limit, SUCCESS_DEG) or 0.0) for limit in LIMITS_M
        ]
    x = Axis(f"error allowed, m (and {SUCCESS_DEG:g} degrees)", LIMITS_M[0], LIMITS_M[-1], log=True)
    return chart("Success against error threshold", x, Axis("share localized within it", 0.0, 1.0), lines, {})


def risk_picture(real: Result) -> str:
    """Risk against coverage of all variants."""
    lines: dict[str, Points] = {}
    for gravity in GRAVITIES:
        cases = real_cases(real, lambda row, gravity=gravity: row["gravity"] == gravity)
        lines |= _risk_line(f"firstfix, gravity {gravity}", cases)
    return _risk_chart("Risk against coverage", lines)


def peers_risk_picture(peers: Result) -> str:
    """Risk against coverage of each peer over the scans of all sets, by its own confidence."""
    lines: dict[str, Points] = {}
    for name, cases in peer_cases(peers).items():
        shown = f"{name} ({len(cases)})"
        lines |= _risk_line(shown, cases) or {shown: []}  # each keeps its colour of the other picture
    return _risk_chart("Risk against coverage, each by its own confidence", lines)


def reliability_picture(real: Result) -> str:
    """Share that is right against the probability that was claimed, over all variants."""
    bins = reliability(real_cases(real, lambda row: True))
    points = [(one.confidence, one.right) for one in bins]
    lines: dict[str, Points] = {"perfect": [(0.0, 0.0), (1.0, 1.0)], "firstfix": points}
    y = Axis("share that is right", 0.0, 1.0)
    return chart("Reliability", Axis("probability claimed", 0.0, 1.0), y, lines, {})


def peers_picture(peers: Result) -> str:
    """Success against the time of a scan, of all peers over the scans of all sets."""
    dots: dict[str, Points] = {}
    for name, cases in peer_cases(peers).items():
        report = report_of(cases)
        dots[f"{name} ({len(cases)})"] = [(report["time_s_p50"], report["success_0.2m_1deg"])]
    x = Axis("median seconds of a scan", 0.01, 100.0, log=True)
    return chart("Time against success", x, Axis("share within 0.2 m, 1 degree", 0.0, 1.0), {}, dots)


def size_picture(scale: Result) -> str:
    """Time of a query against the number of templates."""
    worlds = sorted(scale.figures["worlds"].values(), key=lambda world: world["templates"])
    lines: dict[str, Points] = {
        f"{name} of a query": [(world["templates"], world["anywhere"][key]) for world in worlds]
        for name, key in (("median", "median_ms"), ("p99", "p99_ms"))
    }
    x = Axis("templates of the map", 100.0, 1e7, log=True)
    return chart("Time against map size", x, Axis("ms", 1.0, 1000.0, log=True), lines, {})


def _risk_line(name: str, cases: list[Scored]) -> dict[str, Points]:
    """The curve by its name; nothing where no pose comes with a confidence."""
    curve = risk_coverage(cases)
    if curve is None:
        return {}
    return {name: list(zip(curve.coverage.tolist(), curve.risk.tolist(), strict=True))}


def _risk_chart(title: str, lines: dict[str, Points]) -> str:
    worst = max((risk for points in lines.values() for _, risk in points), default=0.0)
    y = Axis("risk: share of these that is wrong", 0.0, max(0.05, float(np.ceil(worst * 20) / 20)))
    return chart(title, Axis("coverage: share of the cases", 0.0, 1.0), y, lines, {})
