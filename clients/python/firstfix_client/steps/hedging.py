"""The moment at which a second replica is asked, from the policy and from the last answers."""

from __future__ import annotations

import threading
from collections import deque

from ..policies import HedgePolicy

REMEMBERED = 200
ENOUGH = 20


class Hedging:
    """A hedge policy with the response times seen so far. Thread-safe."""

    def __init__(self, policy: HedgePolicy) -> None:
        self._policy = policy
        self._took_s: deque[float] = deque(maxlen=REMEMBERED)
        self._lock = threading.Lock()

    def saw(self, took_s: float) -> None:
        """Records how long an answer took."""
        with self._lock:
            self._took_s.append(took_s)

    def after_s(self) -> float:
        """Returns the seconds after which the second replica is asked."""
        if self._policy.after_s is not None:
            return self._policy.after_s
        with self._lock:
            took_s = sorted(self._took_s)
        seen = took_s[len(took_s) * 95 // 100] if len(took_s) >= ENOUGH else self._policy.first_after_s
        return max(seen, self._policy.min_after_s)
