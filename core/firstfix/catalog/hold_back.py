"""Versions that are published and not activated.

Their map's check holds them back, or their self-test does, or they are worse than the active version.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from ..builds.config import ActivateConfig, PatchMode
from ..findings.finding import Finding
from ..findings.map_kinds import (
    MAP_HELD_BACK,
    PATCH_OUTDATED,
    PATCH_PROPOSED,
    PATCH_WORSE,
    SELF_TEST_CHANGED_LOW,
    SELF_TEST_LOW,
    SELF_TEST_NONE,
    SELF_TEST_REAL_LOW,
    SELF_TEST_WORSE,
)
from ..findings.registry import KINDS
from .manifest import Manifest
from .version_findings import findings_of

BY_CHANCE = 0.1  # a patch that loses scans at unchanged places is worse if chance does so less often
REAL_BY_CHANCE = 0.05  # real scans are too few found if chance does so less often: 1 of 1 wrong tells nothing
_ROUNDING = 1e-6


def reason_to_hold(
    map_id: str, manifest: Manifest, active: Manifest | None, config: ActivateConfig, patch: PatchMode
) -> Finding | None:
    """Finding because of which a version is not activated; None: it is activated.

    A patched version has further reasons. A provisional one is judged by its findings alone, and a config may
    want no self-test.

    Args:
        active: manifest of the active version; None: the map has none.
        patch: what becomes of patched versions.
    """
    words = {"map_id": map_id, "version": manifest.digest}
    held = [one.code for one in findings_of(manifest) if one.code in KINDS and KINDS[one.code].holds_back]
    if held:
        return MAP_HELD_BACK.found(None, codes=", ".join(held), **words)
    if manifest.provisional:
        return None
    patched = manifest.source.get("patch")
    if patched is not None:
        reason = _reason_to_hold_patch(map_id, manifest, patched, active, patch)
        if reason is not None:
            return reason
    return _reason_of_self_test(manifest, active, config, words)


def _reason_of_self_test(
    manifest: Manifest, active: Manifest | None, config: ActivateConfig, words: Mapping[str, str]
) -> Finding | None:
    """The reasons against a version whose self-test asked nothing, found too little, or less than before."""
    tested = manifest.self_test
    if not tested.get("queries"):
        wanted = int((manifest.config.get("self_test") or {}).get("queries", 0))
        return SELF_TEST_NONE.found({"wanted": wanted}, **words) if wanted else None
    found = float(tested["found"])
    if found < config.min_found:
        return SELF_TEST_LOW.found({"found": found, "least": config.min_found}, **words)
    changed = tested.get("changed") or {}
    if changed.get("queries") and float(changed["found"]) < config.min_found:
        return SELF_TEST_CHANGED_LOW.found({"found": changed["found"], "least": config.min_found}, **words)
    real = (tested.get("real") or {}).get("of_source") or {"asked": 0, "found": 0}
    if _chance_of_so_few(real["found"], real["asked"], config.min_real_found) < REAL_BY_CHANCE:
        return SELF_TEST_REAL_LOW.found({**real, "least": config.min_real_found}, **words)
    if active is None or active.provisional or not active.self_test.get("queries"):
        return None
    before = float(active.self_test["found"])
    if found < before - config.max_loss - _ROUNDING:
        return SELF_TEST_WORSE.found({"found": found, "before": before}, **words)
    return None


def _reason_to_hold_patch(
    map_id: str,
    manifest: Manifest,
    patched: Mapping[str, Any],
    active: Manifest | None,
    patch: PatchMode,
) -> Finding | None:
    """The reasons against a patched version: its base, its answers at unchanged places, and the config."""
    words = {"map_id": map_id, "version": manifest.digest}
    if active is None or active.digest != patched["base"]:
        return PATCH_OUTDATED.found(None, base=str(patched["base"])[:12], **words)
    told = patched["compared"]
    before, after = float(told["localized_before"]), float(told["localized_after"])
    by_chance = _chance_of(int(told["lost"]), int(told["won"]))
    wrong_before, wrong_after = float(told["wrong_before"]), float(told["wrong_after"])
    numbers = {"places": float(told["places"]), "before": before, "after": after}
    if by_chance <= BY_CHANCE or wrong_after > wrong_before:
        wrong = {"wrong_before": wrong_before, "wrong_after": wrong_after}
        return PATCH_WORSE.found({**numbers, **wrong}, **words)
    return None if patch == "activate" else PATCH_PROPOSED.found(numbers, **words)


def _chance_of(lost: int, won: int) -> float:
    """Probability that of so many differing answers at least ``lost`` are lost by chance: the sign test."""
    count = lost + won
    return sum(math.comb(count, k) for k in range(lost, count + 1)) / 2**count


def _chance_of_so_few(count: int, of: int, share: float) -> float:
    """Probability that at most ``count`` of so many scans are found if this share of them is: binomial."""
    return sum(math.comb(of, k) * share**k * (1 - share) ** (of - k) for k in range(count + 1))
