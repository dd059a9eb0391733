"""Runs scenarios with a real ROS 2, and prints their figures as JSON.

python -m plugins.fleet.tests.robots.stand_ins jazzy late-starts --count 20 --within 60
python -m plugins.fleet.tests.robots.stand_ins jazzy restarts --count 20
python -m plugins.fleet.tests.robots.stand_ins jazzy recipes
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from pathlib import Path


def main() -> None:
    """Starts itself anew beside ROS, then runs the scenario."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("distribution", choices=["jazzy", "kilted"])
    parser.add_argument("scenario", choices=["late-starts", "restarts", "recipes"])
    parser.add_argument("--count", type=int, default=3)
    parser.add_argument("--within", type=float, default=3.0, help="Seconds.")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    if "_ROS_WHEELS_BOOTSTRAP_COMPLETE" not in os.environ:
        from tests.claimed import any_domain
        from tests.robots.real_ros import real_ros

        environment = real_ros(asked.distribution).environment(
            any_domain(), {"ROS_LOG_DIR": tempfile.gettempdir()}
        )
        os.execve(
            sys.executable,
            [sys.executable, "-m", "plugins.fleet.tests.robots.stand_ins", *sys.argv[1:]],
            environment,
        )
    from plugins.fleet.tests.robots.stand_ins import scenarios
    from plugins.fleet.tests.robots.stand_ins.site import Site

    with tempfile.TemporaryDirectory() as folder, Site(Path(folder)) as site:
        if asked.scenario == "late-starts":
            figures = scenarios.late_starts(site, asked.count, asked.within, asked.seed)
        elif asked.scenario == "restarts":
            figures = scenarios.restarts(site, asked.count, asked.seed)
        else:
            figures = scenarios.recipes(site)
    print(json.dumps(figures))


if __name__ == "__main__":
    main()
