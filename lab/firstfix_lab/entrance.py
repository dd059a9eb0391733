"""``firstfix-lab SUITE [options]``: measures firstfix, or tries to break it.

It runs in a checkout, as suites and drills use what the tests have.
"""

from __future__ import annotations

import sys
from importlib import import_module

from .checkout import ROOT

# Names of suites whose figures the pages show, or that have no options of their own: figures.py runs them.
FIGURES = (
    "ablation",
    "beside",
    "calibration",
    "hostile",
    "paper",
    "peers",
    "real",
    "rebuilds",
    "robust",
    "scale",
    "service",
)
# Programs with options of their own, by the modules whose ``main`` runs them.
PROGRAMS = {
    "bad_maps": "firstfix_lab.suites.bad_maps.program",
    "calibration_parts": "firstfix_lab.suites.calibration.program",
    "encodings": "firstfix_lab.suites.encodings.program",
    "first_answer": "firstfix_lab.suites.first_answer.program",
    "many_maps": "firstfix_lab.suites.many_maps.program",
    "outcomes": "firstfix_lab.suites.outcomes.program",
    "priors": "firstfix_lab.suites.priors.suite",
    "robust_parts": "firstfix_lab.suites.robust.program",
    "ros": "plugins.fleet.tests.robots.matrix",
    "scale_parts": "firstfix_lab.suites.scale.program",
    "scoreboard": "firstfix_lab.scoreboard.program",
    "service_parts": "firstfix_lab.suites.service.program",
    "weak_link": "firstfix_lab.drills.weak_link.program",
}
DRILLS = (
    "ends",
    "frozen",
    "fuzz_bodies",
    "fuzz_files",
    "half_turns",
    "impostors",
    "kill_builds",
    "lossy_dds",
    "neighbours",
    "power_cuts",
    "restart_clients",
    "rot",
    "smoke",
    "vda5050_fleet",
    "vda5050_silent",
    "zenoh_stranger",
)
USAGE = f"""usage: firstfix-lab SUITE [options], and SUITE --help

suites with figures: {", ".join(FIGURES)}
programs:            {", ".join(PROGRAMS)}
drills:              {", ".join(DRILLS)}"""


def main(arguments: list[str]) -> int:
    """Run a suite, a program or a drill and return its exit code."""
    name, options = (arguments[0], arguments[1:]) if arguments else ("", [])
    if name in ("-h", "--help"):
        print(USAGE)
        return 0
    sys.path.insert(0, str(ROOT))  # the tests' helpers
    if name in FIGURES:
        code = import_module("firstfix_lab.figures").main([name, *options])
    elif name in PROGRAMS:
        code = import_module(PROGRAMS[name]).main(options)
    elif name in DRILLS:
        code = import_module(f"firstfix_lab.drills.{name}").main(options)
    else:
        print(USAGE, file=sys.stderr)
        return 2
    return int(code or 0)


def run() -> None:
    """Run the program ``firstfix-lab``."""
    sys.exit(main(sys.argv[1:]))
