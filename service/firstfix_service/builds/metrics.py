"""What the metrics say of a build that ended, and what its log's last words were."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path

from firstfix.builds.records import BuildRecords
from firstfix.errors import FirstfixError

from ..telemetry.metrics import Metrics

# A worker's word becomes a label only if it is one of these: it may be of another release.
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
        "self_test",
        "publish",
    }
)


def count_build(records: BuildRecords, metrics: Metrics, build_id: str, state: str) -> None:
    """Counts a build that ended in a final state, and its stages' times where its worker recorded them."""
    metrics.builds.labels(state).inc()
    with suppress(FirstfixError, TypeError, ValueError, KeyError):  # the figures of one build are no matter
        for stage in records.build_stages(build_id):
            name = stage["stage"] if stage["stage"] in STAGES else "other"
            cached = "yes" if stage["cached"] else "no"
            metrics.build_stage_seconds.labels(name, cached).observe(float(stage["seconds"]))


def last_words(log: Path) -> str | None:
    """The last line of a build's log, or if that is JSON the event that it tells of. None without one."""
    try:
        line = log.read_text(errors="replace").strip().splitlines()[-1]
    except (OSError, IndexError):
        return None
    with suppress(ValueError, KeyError, TypeError):
        return str(json.loads(line)["event"])[:300]
    return line[:300]
