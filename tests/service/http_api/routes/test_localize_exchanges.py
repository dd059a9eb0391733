"""``/localize`` answers what it answered before, byte for byte, and logs and counts the same."""

from __future__ import annotations

import json

from tests.service.http_api.routes.localize_exchanges import RECORDED, record


def test_answers_log_lines_and_metrics_are_as_recorded():
    recorded, found = json.loads(RECORDED.read_text()), record()
    different = [
        f"{service}, {name}: {exchanges.get(name)}\nrecorded: {outcome}"
        for service, outcomes in recorded.items()
        for exchanges in [found[service]]
        for name, outcome in outcomes.items()
        if exchanges.get(name) != outcome
    ]
    assert not different, "\n\n".join(different)
    assert {name: set(of) for name, of in found.items()} == {name: set(of) for name, of in recorded.items()}
