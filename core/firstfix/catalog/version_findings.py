"""Findings of a version: of the map as it was read, of the floor that has templates, and of its places."""

from __future__ import annotations

from ..findings.finding import Finding
from ..findings.map_kinds import MAP_FLOOR_LEFT_OUT, MAP_IN_PART, MAP_PATCHED
from .manifest import Manifest

MAX_LEFT_OUT = 0.3  # of the seen floor: rooms behind closed doors and far sides of roads are less
MAX_IN_PART = 0.1  # of the places: runs that drove through all rooms and roads had 0 to 4 %


def findings_of(manifest: Manifest) -> list[Finding]:
    """Findings that a version's manifest has or shows."""
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
    if left_out > MAX_LEFT_OUT:
        found.append(MAP_FLOOR_LEFT_OUT.found({"left_out_share": left_out}))
    mapped = manifest.self_test.get("mapped") or {}
    if mapped.get("in_part", 0) > MAX_IN_PART * mapped.get("places", 0):
        found.append(MAP_IN_PART.found({name: mapped[name] for name in ("places", "in_part")}))
    return found
