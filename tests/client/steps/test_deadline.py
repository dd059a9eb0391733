"""Deadlines of calls, and waits that a service asks for."""

from __future__ import annotations

import pytest

from firstfix.errors import DeadlineExceeded
from firstfix_client.steps.http_sender import retry_after_s
from firstfix_client.steps.send import Deadline
from tests.waiting import let_pass


@pytest.mark.parametrize(
    ("header", "seconds"),
    [("2", 2.0), ("0", 0.0), (None, None), ("", None), ("-1", None), ("nan", None), ("inf", None)]
    + [("Wed, 21 Oct 2026 07:28:00 GMT", None)],
)
def test_retry_after(header, seconds):
    assert retry_after_s(header) == seconds


def test_a_deadline_passes():
    long, short = Deadline(1000), Deadline(0.05)
    assert 0 < long.remaining_s() <= 1000
    assert long.allows(1)
    assert not long.allows(1001)
    let_pass(0.06)
    with pytest.raises(DeadlineExceeded):
        short.remaining_s()
