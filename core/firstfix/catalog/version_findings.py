"""Findings of a version: of the map as it was read, and of the floor that has templates."""

from __future__ import annotations

from ..findings.finding import Finding
from ..findings.map_kinds import MAP_FLOOR_LEFT_OUT, MAP_PATCHED
from .manifest import Manifest

MOST_LEFT_OUT = 0.3  # of the seen floor: rooms behind closed doors and far sides of roads are less


def findings_of(manifest: Manifest) -> list[Finding]:
    """Findings that a version's manifest has or shows. Earlier releases looked for none in the map."""
    found = [Finding.from_mapping(one) for one in manifest.source.get("findings", ())]
    if (patched := manifest.source.get("patch")) is not None:
        numbers = {
            "queries": patched["queries"],
            "robots": patched["robots"],
            "areas": len(patched["areas"]),
            "added": patched["added_points"],
            "removed": patched["removed_points"],
        }
        found.append(MAP_PATCHED.found(numbers, base=str(patched["base"])[:12]))
    left_out = (manifest.self_test.get("floor") or {}).get("without_template", 0.0)
    if left_out > MOST_LEFT_OUT:
        found.append(MAP_FLOOR_LEFT_OUT.found({"left_out_share": left_out}))
    return found
