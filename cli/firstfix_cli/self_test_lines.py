"""The self-test of a version as text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def self_test_lines(tested: Mapping[str, Any]) -> list[str]:
    """Returns the results that the build measured on perturbed scans."""
    if not tested.get("queries"):
        return ["self-test: none"]
    success = ", ".join(f"{share:.0%} within {limit}" for limit, share in tested["success"].items())
    return [
        f"self-test, {tested['queries']} perturbed scans: {success}",
        f"  median error {tested['median_error_m']:.3f} m, {tested['localized']:.0%} answered localized, "
        f"{tested['false_accepts']} false among them and {tested['outside']} scans from elsewhere",
    ]
