"""Versions that are published and not activated: by their self-test, or worse than the active version."""

from __future__ import annotations

from ..builds.config import ActivateConfig
from ..findings.finding import Finding
from ..findings.map_kinds import SELF_TEST_LOW, SELF_TEST_WORSE
from .manifest import Manifest

_ROUNDING = 1e-6


def reason_to_hold(
    map_id: str, manifest: Manifest, active: Manifest | None, config: ActivateConfig
) -> Finding | None:
    """Finding because of which a version is not activated; None: it is activated.

    A version without a self-test has no reason: it is provisional, or its config wanted none.

    Args:
        active: manifest of the active version; None: the map has none.
    """
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


def _localized(manifest: Manifest) -> float | None:
    """Share of the self-test's scans in the map that were localized; None: none was asked."""
    return float(manifest.self_test["localized"]) if manifest.self_test.get("queries") else None
