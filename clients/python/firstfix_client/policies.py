"""Policies of a client: when to send a request again, and when to ask a second replica."""

from __future__ import annotations

import random
from dataclasses import dataclass


@dataclass(frozen=True)
class RetryPolicy:
    """Policy for sending a failed request again.

    Attributes:
        attempts: limit on tries, the first one included; 1 turns retries off; None: no limit but the time.
        first_wait_s: upper bound of the wait before all replicas are asked again. It doubles every round.
        max_wait_s: upper bound of any wait, unless the service asks for a longer one.
        patience_s: no try starts later than this after the first. A call with a long timeout, such as an
            upload, does not wait for hours for a service that is down.
    """

    attempts: int | None = None
    first_wait_s: float = 0.1
    max_wait_s: float = 1.0
    patience_s: float = 60.0

    def wait_s(self, attempt: int, retry_after_s: float | None = None) -> float:
        """The seconds to wait after round number ``attempt`` (from 1) failed.

        The wait is random over the whole interval ("full jitter"): robots that lost their service at the same
        moment must not come back at the same moment. It is never shorter than the service asked for.
        """
        if retry_after_s is not None:
            return retry_after_s * random.uniform(1.0, 1.25)
        return random.uniform(0, min(self.max_wait_s, self.first_wait_s * 2 ** min(attempt - 1, 30)))


@dataclass(frozen=True)
class HedgePolicy:
    """Policy for asking a second replica because the first one is slow.

    Attributes:
        after_s: seconds until the second replica is asked; None: the time within which 95 % of the last
            answers came, so about one query in twenty is sent twice.
        first_after_s: used instead of that time until there are enough answers.
        min_after_s: lower bound.
    """

    after_s: float | None = None
    first_after_s: float = 0.5
    min_after_s: float = 0.02
