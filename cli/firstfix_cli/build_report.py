"""Results of a build as text: reused stages and chunks, and the self-test of the version."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

_HELPS = {
    "second_scan": "a second scan from 1 to 2 m further on, or a prior",
    "prior": "a prior, as what looks alike is above, below or beside it",
    "other_height": "a scan from another height, or a second one from 1 to 2 m further on",
    "drive_through": "driving through it while mapping, as it was mapped in part",
}


def reused_lines(stages: Iterable[Mapping[str, Any]]) -> list[str]:
    """One line about the stages and chunks of earlier builds that were reused; no line if none were.

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


def kept_lines(rebuilt: Mapping[str, Any] | None) -> list[str]:
    """One line about what is kept of earlier versions; no line if nothing is.

    Args:
        rebuilt: record of the manifest.
    """
    if not rebuilt:
        return []
    keys, calibration = rebuilt["keys_of"][:12], rebuilt["calibration_of"]
    changed = f"{rebuilt['changed'] + rebuilt['gone']:,} templates have changed since {rebuilt['base'][:12]}"
    kept = f"keys kept of version {keys}"
    kept += f", calibration of {calibration[:12]}" if calibration else ", calibration taught anew"
    return [f"{changed}: {kept}"]


def self_test_lines(tested: Mapping[str, Any]) -> list[str]:
    """The results that the build measured on perturbed scans."""
    if not tested.get("queries"):
        return ["self-test: none", *_left_out_lines(tested)]
    success = ", ".join(f"{share:.0%} within {limit}" for limit, share in tested["success"].items())
    lines = [
        f"self-test, {tested['queries']} perturbed scans: {success}",
        f"  {tested['found']:.0%} of the places found, {_median(tested['median_error_m'])}, "
        f"{tested['localized']:.0%} answered localized, "
        f"{tested['false_accepts']} false among them and {tested['outside']} scans from elsewhere",
    ]
    lines += _part_lines(tested.get("parts", {}))
    lines += _real_lines(tested.get("real", {}))
    threshold = tested.get("threshold")
    if threshold is not None:
        lines += _threshold_lines(threshold)
    rows = tested.get("false_accept_bound", {}).get("rows", ())
    least = next((row for row in rows if row["bound"] == rows[-1]["bound"]), None)
    if least is not None:
        lines.append(
            f"  from probability {least['min_probability']} at most {least['bound']:.2%} of scans from "
            "elsewhere are localized (95% confidence)"
        )
    return [*lines, *_left_out_lines(tested)]


def _median(error_m: float | None) -> str:
    """The median error."""
    return "no median error" if error_m is None else f"median error {error_m:.3f} m"


def _left_out_lines(tested: Mapping[str, Any]) -> list[str]:
    """Lines about floor without templates, places mapped in part, and moving things, if any."""
    lines = []
    share = (tested.get("floor") or {}).get("without_template", 0.0)
    if share:
        lines.append(f"{max(share, 0.01):.0%} of the seen floor has no template: not reachable")
    lines += _in_part_lines(tested.get("mapped") or {})
    lines += _not_said_lines(tested.get("localizability") or ())
    moving = tested.get("moving") or {}
    if moving.get("left_out"):
        lines.append(f"{moving['left_out']:.1%} of the points left out: later rays passed through them")
    elif moving.get("passed"):
        lines.append(f"rays passed through {moving['passed']:.1%} of the points, so none was left out")
    if moving.get("not_used"):
        name, reason = next(iter(moving["not_used"].items()))
        lines.append(f"{len(moving['not_used'])} mapping scans not used, such as {name}: {reason}")
    return lines


def _in_part_lines(mapped: Mapping[str, Any]) -> list[str]:
    """How many places were mapped in part, and how scans do there; no line if none were."""
    if not mapped.get("in_part"):
        return []
    here, elsewhere = mapped["localized_in_part"], mapped["localized_elsewhere"]
    compared = (
        ""
        if None in (here, elsewhere)
        else f": {here:.0%} of scans localized there, {elsewhere:.0%} elsewhere"
    )
    count = f"{mapped['in_part']} of {mapped['places']} places"
    return [f"{count} were mapped in part, from a door or from afar{compared}"]


def _not_said_lines(grid: Sequence[Mapping[str, Any]]) -> list[str]:
    """How many places are known and not said, and what helps there; no line if none is."""
    silent = Counter(one["helps"] for one in grid if "helps" in one)
    if not silent:
        return []
    helps = [f"  {_HELPS.get(code, code)}: {count}" for code, count in sorted(silent.items())]
    are = "is" if silent.total() == 1 else "are"
    count = f"{silent.total()} of {len(grid)} places {are} known and not said"
    return [f"{count}: the right one is the best or ties, and is not sure. What helps there:", *helps]


def _threshold_lines(threshold: Mapping[str, Any]) -> list[str]:
    """Promise of the version's answers, and what other promises would cost."""
    promises = [threshold, *threshold["others"]]
    asked, *others = (f"1 in {1 / one['max_false_accept']:,.0f}" for one in promises)
    shown = f"at most {threshold['bound']:.2%}"
    how = {
        "rate": f"the self-test shows {shown}",
        "many maps": f"many maps show {shown}",
        "each answer": f"each answer by itself; the self-test shows {shown}",
    }[threshold["kept_by"]]
    shares = (f"{one['localized']:.0%} at {other}" for one, other in zip(promises[1:], others, strict=True))
    return [
        f"  localized from probability {threshold['min_probability']:g}: at most {asked} wrong ({how})",
        f"  localized, by how many may be wrong: {', '.join(shares)}",
    ]


def _part_lines(parts: Mapping[str, Any]) -> list[str]:
    """How many scans were localized by how roughly they were disturbed, if there are both kinds."""
    told = [
        f"{part['localized']:.0%} of {part['queries']} disturbed {how}"
        for how, part in parts.items()
        if part["queries"]
    ]
    return [f"  localized: {', '.join(told)}"] if len(told) > 1 else []


def _days(told: Mapping[str, Any]) -> str:
    """The days between which queries were confirmed."""
    if not told["told_from"]:
        return "on unknown days"
    return f"{told['told_from'][:10]} to {told['told_to'][:10]}"


def _real_lines(real: Mapping[str, Any]) -> list[str]:
    """Results of the source's real scans, and which of them were left out."""
    lines = []
    if real.get("asked"):
        success = ", ".join(f"{share:.0%} within {limit}" for limit, share in real["success"].items())
        lines = [
            f"  {real['asked']} real scans, each as heavy as {real['weight']:g} simulated ones: {success}",
            f"    {_median(real['median_error_m'])}, {real['localized']:.0%} answered localized, "
            f"{real['false_accepts']} false among them",
        ]
        told = real.get("confirmed", {})
        if told.get("asked"):
            lines.append(
                f"    {told['asked']} of them queries of {told['robots']} robots, confirmed by "
                f"{told['told_by']} callers, {_days(told)}"
            )
        if real["disagree"]:
            about = ", ".join(real["disagree"])
            lines.append(f"    real and simulated scans disagree ({about}): believe the real ones")
    lines += _keyframe_lines(real.get("held_out") or {})
    if real.get("left_out"):
        lines.append("  real scans left out:")
        lines += [f"    {name}: {reason}" for name, reason in real["left_out"].items()]
    return lines


def _keyframe_lines(held_out: Mapping[str, Any]) -> list[str]:
    """How many keyframes a map that is made of its scans was made without, and why not more."""
    lines = []
    if held_out.get("keyframes"):
        count = f"{held_out['keyframes']} keyframes in {held_out['parts']} parts"
        lines.append(f"    the map was made without {count}")
    kept = held_out.get("kept_out", {})
    return [*lines, *(f"    {count} keyframes could not be held out: {why}" for why, count in kept.items())]
