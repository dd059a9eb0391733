"""Results of a build as text: reused stages and chunks, and the self-test of the version."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any


def reused_lines(stages: Iterable[Mapping[str, Any]]) -> list[str]:
    """Returns one line about the stages and chunks of earlier builds that were reused; no line if none were.

    Args:
        stages: ``stage``, ``cached``, ``chunks`` and ``chunks_reused`` of each.
    """
    taken = [str(one["stage"]) for one in stages if one.get("cached")]
    taken += [
        f"{one['chunks_reused']:,} of {one['chunks']:,} chunks of {one['stage']}"
        for one in stages
        if one.get("chunks_reused")
    ]
    return [f"reused from earlier builds: {', '.join(taken)}"] if taken else []


def self_test_lines(tested: Mapping[str, Any]) -> list[str]:
    """Returns the results that the build measured on perturbed scans."""
    if not tested.get("queries"):
        return ["self-test: none", *_left_out_lines(tested)]
    success = ", ".join(f"{share:.0%} within {limit}" for limit, share in tested["success"].items())
    lines = [
        f"self-test, {tested['queries']} perturbed scans: {success}",
        f"  median error {tested['median_error_m']:.3f} m, {tested['localized']:.0%} answered localized, "
        f"{tested['false_accepts']} false among them and {tested['outside']} scans from elsewhere",
    ]
    rows = tested.get("false_accept_bound", {}).get("rows", ())
    least = next((row for row in rows if row["bound"] == rows[-1]["bound"]), None)
    if least is not None:
        lines.append(
            f"  from probability {least['min_probability']} at most {least['bound']:.2%} of scans from "
            "elsewhere are localized (95% confidence)"
        )
    return [*lines, *_left_out_lines(tested)]


def _left_out_lines(tested: Mapping[str, Any]) -> list[str]:
    """Returns lines about seen floor without templates, and points of moving things; none without them."""
    lines = []
    share = (tested.get("floor") or {}).get("without_template", 0.0)
    if share:
        lines.append(f"{max(share, 0.01):.0%} of the seen floor has no template: not reachable")
    moving = tested.get("moving") or {}
    if moving.get("left_out"):
        lines.append(f"{moving['left_out']:.1%} of the points left out: later rays passed through them")
    elif moving.get("passed"):
        lines.append(f"rays passed through {moving['passed']:.1%} of the points, so none was left out")
    if moving.get("not_used"):
        name, reason = next(iter(moving["not_used"].items()))
        lines.append(f"{len(moving['not_used'])} mapping scans not used, such as {name}: {reason}")
    return lines
