"""When a second replica is asked because the first one is slow."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass

REMEMBERED = 200
ENOUGH = 20


@dataclass(frozen=True)
class HedgePolicy:
    """
    Attributes:
        after_s: seconds after which another replica is asked too; None: the time within which 95 % of the
            last answers came, so that about one query in twenty is asked twice.
        first_after_s: in place of that time until enough answers came.
        min_after_s: never earlier than this.
    """

    after_s: float | None = None
    first_after_s: float = 0.5
    min_after_s: float = 0.02


class Hedging:
    """The policy together with what answers took. Thread-safe."""

    def __init__(self, policy: HedgePolicy) -> None:
        self._policy = policy
        self._took_s: deque[float] = deque(maxlen=REMEMBERED)
        self._lock = threading.Lock()

    def saw(self, took_s: float) -> None:
        with self._lock:
            self._took_s.append(took_s)

    def after_s(self) -> float:
        if self._policy.after_s is not None:
            return self._policy.after_s
        with self._lock:
            took_s = sorted(self._took_s)
        seen = took_s[len(took_s) * 95 // 100] if len(took_s) >= ENOUGH else self._policy.first_after_s
        return max(seen, self._policy.min_after_s)
