"""Versions that are published and not activated: by their self-test, or worse than the active version."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from ..builds.config import ActivateConfig, PatchMode
from ..findings.finding import Finding
from ..findings.map_kinds import (
    PATCH_OUTDATED,
    PATCH_PROPOSED,
    PATCH_WORSE,
    SELF_TEST_LOW,
    SELF_TEST_WORSE,
)
from .manifest import Manifest

BY_CHANCE = 0.1  # a patch that loses scans at unchanged places is worse if chance does so less often
_ROUNDING = 1e-6


def reason_to_hold(
    map_id: str, manifest: Manifest, active: Manifest | None, config: ActivateConfig, patch: PatchMode
) -> Finding | None:
    """Finding because of which a version is not activated; None: it is activated.

    A version without a self-test has no reason: it is provisional, or its config wanted none. A patched
    version has further reasons.

    Args:
        active: manifest of the active version; None: the map has none.
        patch: what becomes of patched versions.
    """
    patched = manifest.source.get("patch")
    if patched is not None:
        held = _reason_to_hold_patch(map_id, manifest, patched, active, patch)
        if held is not None:
            return held
    localized = _localized(manifest)
    if localized is None:
        return None
    words = {"map_id": map_id, "version": manifest.digest}
    if localized < config.min_localized:
        return SELF_TEST_LOW.found({"localized": localized, "least": config.min_localized}, **words)
    before = None if active is None else _localized(active)
    if before is not None and localized < before - config.max_loss - _ROUNDING:
        return SELF_TEST_WORSE.found({"localized": localized, "before": before}, **words)
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


def _localized(manifest: Manifest) -> float | None:
    """Share of the self-test's scans in the map that were localized; None: none was asked."""
    return float(manifest.self_test["localized"]) if manifest.self_test.get("queries") else None
