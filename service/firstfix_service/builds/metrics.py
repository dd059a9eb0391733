"""Metrics of a build that ended, and the last message of its log."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path

from firstfix.builds.records import BuildRecords
from firstfix.errors import FirstfixError

from ..telemetry.metrics import Metrics

# Only these names become labels: a build worker of another release may report others.
STAGES = frozenset(
    {
        "fetch_source",
        "read_map",
        "reconstruct_mesh",
        "sample_viewpoints",
        "fit_engine",
        "make_templates",
        "cluster",
        "learn_keys",
        "build_index",
        "draw_cloud",
        "self_test",
        "publish",
    }
)


def count_build(records: BuildRecords, metrics: Metrics, build_id: str, state: str) -> None:
    """Counts a build that ended, and the times of its stages if its process recorded them."""
    metrics.builds.labels(state).inc()
    with suppress(FirstfixError, TypeError, ValueError, KeyError):  # missing times of one build do no harm
        for stage in records.build_stages(build_id):
            name = stage["stage"] if stage["stage"] in STAGES else "other"
            cached = "yes" if stage["cached"] else "no"
            metrics.build_stage_seconds.labels(name, cached).observe(float(stage["seconds"]))


def last_message(log: Path) -> str | None:
    """Returns the last line of a build's log, or its event if the line is JSON; None if there is no line."""
    try:
        line = log.read_text(errors="replace").strip().splitlines()[-1]
    except (OSError, IndexError):
        return None
    with suppress(ValueError, KeyError, TypeError):
        return str(json.loads(line)["event"])[:300]
    return line[:300]
