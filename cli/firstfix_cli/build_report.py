"""Stages and chunks that a build took over from earlier ones, as text."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any


def reused_lines(stages: Iterable[Mapping[str, Any]]) -> list[str]:
    """Returns one line about stages and chunks that an earlier build had made, or none if it made nothing.

    Args:
        stages: ``stage``, ``cached``, ``chunks`` and ``chunks_reused`` of each.
    """
    taken = [str(one["stage"]) for one in stages if one.get("cached")]
    taken += [
        f"{one['chunks_reused']:,} of {one['chunks']:,} chunks of {one['stage']}"
        for one in stages
        if one.get("chunks_reused")
    ]
    return [f"taken over from earlier builds: {', '.join(taken)}"] if taken else []
