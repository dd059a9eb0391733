"""A version's self-test for people."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def self_test_lines(tested: Mapping[str, Any]) -> list[str]:
    """What the version can do, as its builder measured it on perturbed scans."""
    if not tested.get("queries"):
        return ["self-test: none"]
    success = ", ".join(f"{share:.0%} within {limit}" for limit, share in tested["success"].items())
    return [
        f"self-test, {tested['queries']} perturbed scans: {success}",
        f"  median error {tested['median_error_m']:.3f} m, {tested['localized']:.0%} answered localized, "
        f"{tested['false_accepts']} false among them and {tested['outside']} scans from elsewhere",
    ]
