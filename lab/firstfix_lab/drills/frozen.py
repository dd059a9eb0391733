"""Freezes the parts of a deployment under mixed load, each alone and in pairs: who else is held up?

    firstfix-lab frozen [--only PART ...] [--pairs yes|no|only] [--ending thaw|kill|both]
                                  [--seconds 40] [--pair-seconds 12] [--root PATH] [--json FILE]

SIGSTOP stops a zenoh peer with replies waiting, a zenoh router, an HTTP reader, the object store, a query
worker, a build worker and NATS, while two callers localize over HTTP and one over zenoh, maps are submitted,
uploaded and activated, and metrics read. Then the part goes on, or is killed and started again. Meanwhile
calls that do not need the part are answered as before (p99 at most twice as long, plus 0.25 s for a busy
machine), those that need it end within 30 s, the service and its children grow by at most 200 MB, and
everything is back within 10 s. It takes about 20 minutes. --root: the checkout whose service is tried.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import json
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from firstfix_lab.checkout import ROOT

from .freezing.calls import calls_to
from .freezing.case import Case, Figures, run_case
from .freezing.deployment import Deployment
from .freezing.load import Load
from .freezing.outcomes import Outcomes
from .freezing.part import LOCALIZE, Part
from .freezing.watch import Watch

PARTS = ("zenoh peer", "zenoh router", "http reader", "object store", "query worker", "build worker", "NATS")
Choice = Callable[[dict[str, Part]], list[Case]]


def frozen(
    folder: Path, root: Path, choose: Choice, tell: Callable[[Figures], None], readers: int = 100
) -> tuple[list[Figures], list[str]]:
    """Run cases in one deployment; returns their figures, and the processes that it would have left.

    Args:
        folder: empty; of the store and the logs.
        root: checkout whose service is tried.
        choose: returns the cases, given the parts by name.
        tell: called after each case.
        readers: connections of the HTTP reader.
    """
    deployment, outcomes, found = Deployment(folder, root, readers), Outcomes(), []
    try:
        yard = deployment.start()
        with (
            calls_to(deployment.url, deployment.endpoint, deployment.router_endpoint, yard) as calls,
            Watch(deployment.url, lambda: deployment.service.pid, deployment.watch_over) as watch,
            Load(calls.kinds(), outcomes) as load,
        ):
            for case in choose(deployment.parts):
                found.append(run_case(case, deployment, calls, load, outcomes, watch))
                tell(found[-1])
    finally:
        left = deployment.stop()
    return found, left


def cases_of(parts: dict[str, Part], given: argparse.Namespace) -> list[Case]:
    """The cases that the options ask for."""
    chosen = [parts[name] for name in PARTS if not given.only or name in given.only]
    endings = ("thaw", "kill") if given.ending == "both" else (given.ending,)
    cases = []
    if given.pairs != "only":
        cases += [Case((part,), "thaw", given.seconds) for part in chosen if "thaw" in endings]
        cases += [Case((part,), "kill", given.pair_seconds) for part in chosen if "kill" in endings]
    if given.pairs != "no":
        pairs = list(itertools.combinations(chosen, 2))
        ending = "kill" if given.ending == "kill" else "thaw"
        cases += [Case(pair, ending, given.pair_seconds) for pair in pairs]
    return cases


def row(figures: Figures) -> str:
    """One line of the table."""
    slowest = max(
        (kind for kind in LOCALIZE if kind in figures.during and kind in figures.before),
        key=lambda kind: figures.during[kind].p99_s,
        default=None,
    )
    cells = [figures.name]
    if slowest is None:
        cells += ["-", "-"]
    else:
        cells += [_times(one[slowest]) for one in (figures.before, figures.during)]  # type: ignore[index]
    cells.append("/".join(f"{lag * 1e3:.0f}" for lag in figures.lag_s))
    cells.append(f"{figures.grown_bytes / 1e6:+.0f}")
    late = max(figures.back_s, key=lambda what: figures.back_s[what] or float("inf"), default="")
    took = figures.back_s.get(late)
    cells.append("never" if took is None else f"{took:.1f} ({late})")
    cells.append(", ".join(f"{count} {what}" for what, count in sorted(figures.errors.items())) or "none")
    cells.append("; ".join([*figures.missed, *figures.missed_times]) or "none")
    return "| " + " | ".join(cells) + " |"


def _times(latency: object) -> str:
    return "/".join(f"{getattr(latency, name) * 1e3:.0f}" for name in ("p50_s", "p99_s", "worst_s"))


HEAD = """\
| frozen | localize before: p50/p99/worst ms | frozen | /healthz worst ms before/frozen/after | MB \
| back s | errors | bars missed |
|---|---|---|---|---|---|---|---|"""


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(
        prog="firstfix-lab frozen", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--only", nargs="+", choices=PARTS, metavar="PART", help=", ".join(PARTS))
    parser.add_argument("--pairs", choices=("yes", "no", "only"), default="yes")
    parser.add_argument("--ending", choices=("thaw", "kill", "both"), default="both")
    parser.add_argument("--seconds", type=float, default=40.0, help="of a part alone")
    parser.add_argument("--pair-seconds", type=float, default=12.0, help="of a pair, and before a kill")
    parser.add_argument("--root", type=Path, default=ROOT)
    parser.add_argument("--folder", type=Path, help="where store and logs are left")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here")
    given = parser.parse_args(arguments)
    print(HEAD, flush=True)
    with tempfile.TemporaryDirectory() as own:
        figures, left = frozen(
            given.folder or Path(own),
            given.root.resolve(),
            lambda parts: cases_of(parts, given),
            lambda one: print(row(one), flush=True),
        )
    if given.json:
        given.json.write_text(json.dumps([dataclasses.asdict(one) for one in figures], indent=1) + "\n")
    if left:
        print("left:", *left, sep="\n", file=sys.stderr)
    return int(bool(left) or any(one.missed or one.missed_times for one in figures))
