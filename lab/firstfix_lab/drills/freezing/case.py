"""One case of the drill: parts are frozen under load, and continued or killed; figures and what they miss."""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import reduce
from operator import or_

from .calls import Calls
from .deployment import Deployment
from .load import Load
from .outcomes import Call, Latency, Outcomes, errors, latency
from .part import LOCALIZE, Effect, Part
from .watch import Watch

BEFORE_S, WINDOW_S = 8.0, 4.0
FACTOR, FLOOR_S = 2.0, 0.25  # of a p99: two cores, shared with whatever else runs here
MIN_CALLS = 10  # of which a p99 says anything
MAX_BYTES = 200_000_000
BACK_S = 10.0
BOUND_S = 30.0  # for calls that need what is frozen
SLACK_S = 1.0  # by which a call may begin later than it was due
HELD_UP_S = 3.0  # by which nobody else's call may take longer than before: a median hides a short halt


@dataclass(frozen=True)
class Case:
    """Parts that are frozen together.

    Attributes:
        ending: "thaw" or "kill"; a killed part is started again at once.
        seconds: for which the parts are frozen.
        given_up_s: after the end of the frost, what is not back will not come.
    """

    parts: tuple[Part, ...]
    ending: str
    seconds: float
    given_up_s: float = 40.0

    @property
    def name(self) -> str:
        return " + ".join(part.name for part in self.parts) + (", killed" if self.ending == "kill" else "")


@dataclass
class Figures:
    """Figures of one case.

    Attributes:
        before, during: latency by kind.
        errors: calls that failed, by kind and code.
        lag_s: worst answer of /healthz before, during and after.
        grown_bytes: memory of the service and its children, over the largest before.
        back_s: by what had to come back: seconds after the end of the frost; None: not at all.
        deaths: of the service, which was started again.
        missed, missed_times: bars, and those that judge a time.
    """

    name: str
    before: dict[str, Latency] = field(default_factory=dict)
    during: dict[str, Latency] = field(default_factory=dict)
    errors: dict[str, int] = field(default_factory=dict)
    lag_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    grown_bytes: int = 0
    back_s: dict[str, float | None] = field(default_factory=dict)
    deaths: int = 0
    missed: list[str] = field(default_factory=list)
    missed_times: list[str] = field(default_factory=list)


def run_case(
    case: Case, deployment: Deployment, calls: Calls, load: Load, outcomes: Outcomes, watch: Watch
) -> Figures:
    """Run a case and return its figures; a service that does not come back is started anew."""
    figures = Figures(case.name)
    deaths = deployment.deaths
    begin = time.monotonic()
    time.sleep(min(BEFORE_S, case.seconds))
    frozen = time.monotonic()
    for part in case.parts:
        part.freeze()
    time.sleep(case.seconds)
    ended = time.monotonic()
    for part in case.parts:
        if case.ending == "thaw":
            part.thaw()
        else:
            part.kill()
            part.start()
    given_up = ended + case.given_up_s
    figures.back_s = _wait_until_back(calls, load, outcomes, ended, given_up)
    back = time.monotonic()
    time.sleep(SLACK_S)
    while outcomes.has_open(back) and time.monotonic() < given_up:
        time.sleep(0.05)
    figures.deaths = deployment.deaths - deaths
    effect = reduce(or_, (part.effect for part in case.parts))
    figures.before = _latencies(outcomes.between(begin, frozen), begin, frozen)
    _see_calls(figures, effect, outcomes, frozen, ended, back)
    figures.lag_s = (
        watch.worst_lag_s(begin, frozen),
        watch.worst_lag_s(frozen, ended),
        watch.worst_lag_s(ended, back),
    )
    figures.grown_bytes = watch.most_bytes(frozen, back) - watch.most_bytes(begin, frozen)
    _judge(figures, effect)
    if None in figures.back_s.values():
        deployment.restart()
    return figures


def _wait_until_back(
    calls: Calls, load: Load, outcomes: Outcomes, ended: float, deadline: float
) -> dict[str, float | None]:
    """Wait until each kind of call was answered, a catalog's change was followed, and a build has run."""
    with ThreadPoolExecutor(2) as threads:
        others = {
            "catalog change": threads.submit(_follow_change, calls, deadline),
            "builds": threads.submit(_run_builds, calls, deadline),
        }
        # The next build is due seconds later; the one that is submitted here comes at once.
        at: dict[str, float | None] = {kind: None for kind in load.kinds if kind != "build"}
        while None in at.values() and time.monotonic() < deadline:
            for kind, seen in at.items():
                if seen is None:
                    at[kind] = outcomes.first_good(kind, ended)
            time.sleep(0.05)
        at |= {what: done.result() for what, done in others.items()}
    return {what: None if seen is None else seen - ended for what, seen in at.items()}


def _follow_change(calls: Calls, deadline: float) -> float | None:
    """Activate another version; returns when a query was answered from it."""
    wanted = ""
    while time.monotonic() < deadline:
        answering = calls.answering_version()
        if answering == wanted:
            return time.monotonic()
        if not wanted and answering in calls.versions:
            other = calls.versions[1 - calls.versions.index(answering)]
            wanted = other if calls.activate(other) == "ok" else ""
        time.sleep(0.1)
    return None


def _run_builds(calls: Calls, deadline: float) -> float | None:
    """Submit a build; returns when it has succeeded, or one of those that waited before it."""
    is_submitted = False
    while time.monotonic() < deadline:
        is_submitted = is_submitted or calls.submit().startswith("/")
        waiting = calls.unfinished_builds()
        time.sleep(0.1)
        if is_submitted and any(calls.build_state(one) == "succeeded" for one in waiting):
            return time.monotonic()
    return None


def _latencies(calls: Sequence[Call], begin: float, end: float) -> dict[str, Latency]:
    kinds = sorted({call.kind for call in calls})
    found = {
        kind: latency([call for call in calls if call.kind == kind], begin, end, WINDOW_S) for kind in kinds
    }
    return {kind: one for kind, one in found.items() if one is not None}


def _see_calls(
    figures: Figures, effect: Effect, outcomes: Outcomes, frozen: float, ended: float, back: float
) -> None:
    calls = outcomes.between(frozen, back)
    figures.errors = dict(errors(calls))
    lost = sorted(
        (call for call in calls if call.kind in LOCALIZE and call.due < ended),
        key=lambda call: (call.code != "ok", call.seconds),
    )[::-1][: effect.lost]
    calls = [call for call in calls if call not in lost]
    figures.during = _latencies([call for call in calls if call.due < ended], frozen, ended)
    for failed, count in sorted(errors(calls).items()):
        kind, code = failed.split(": ", 1)
        if code not in effect.codes.get(kind, ()):
            figures.missed.append(f"{count} x {failed}")


def _judge(figures: Figures, effect: Effect) -> None:
    for kind, during in figures.during.items():
        before = figures.before.get(kind)
        if kind in effect.codes:
            if during.worst_s > BOUND_S:
                figures.missed_times.append(f"{kind} took {during.worst_s:.1f} s")
        elif before is not None and during.calls >= MIN_CALLS:
            told = f"p99 of {kind} {before.p99_s * 1e3:.0f} -> {during.p99_s * 1e3:.0f} ms"
            if during.p99_s > FACTOR * before.p99_s + FLOOR_S:
                figures.missed_times.append(told)
            elif during.worst_s > before.worst_s + HELD_UP_S:
                figures.missed_times.append(f"a call of {kind} took {during.worst_s:.1f} s")
    if figures.grown_bytes > MAX_BYTES:
        figures.missed.append(f"memory +{figures.grown_bytes / 1e6:.0f} MB")
    for what, seconds in figures.back_s.items():
        if seconds is None:
            figures.missed.append(f"{what} not back")
        elif seconds > BACK_S:
            figures.missed_times.append(f"{what} back after {seconds:.1f} s")
