"""The metrics of a system's answers as lines for people."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .metrics import RISKS, SUCCESS


def lines_of(report: Mapping[str, Any]) -> list[str]:
    """The lines of ``metrics.report_of``."""
    success = ", ".join(
        f"{_percent(report[f'success_{m:g}m_{deg:g}deg'])} within {m:g} m, {deg:g} deg" for m, deg in SUCCESS
    )
    coverage = ", ".join(f"{_percent(report[f'coverage_at_risk_{r:g}'])} at a risk of {r:.0%}" for r in RISKS)
    return [
        f"{report['cases']} cases, {report['outside']} outside the map: {report['accepted']} accepted, "
        f"{report['no_pose']} without a pose",
        f"  accepted and right    {success}",
        f"  right, even if not    {_percent(report['right_first'])} within 0.2 m and 1 deg",
        f"  false accepts         {report['false_accepts']}",
        f"  coverage              {coverage}; mean risk {_number(report['area_under_risk_coverage'])}",
        f"  calibration           ECE {_number(report['ece'])}, Brier {_number(report['brier'])}",
        f"  s                     p50 {_number(report['time_s_p50'])}, p95 {_number(report['time_s_p95'])}",
    ]


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{share:.1%}"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"
