"""Runs a fault drill: ``python -m tests.faults DRILL [options]``, or ``make faults ARGS="DRILL [options]"``.

A drill breaks something again and again (power, processes, bodies) and ends with an error when anything is
lost. Small versions of the drills are tests of this folder and of ``tests/service``.
"""

from __future__ import annotations

import argparse
import sys
from importlib import import_module

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


def main() -> int:
    parser = argparse.ArgumentParser(prog="tests.faults", description="Runs a fault drill.")
    parser.add_argument("drill", choices=DRILLS)
    parser.add_argument("options", nargs=argparse.REMAINDER, help="of the drill: see DRILL --help")
    chosen = parser.parse_args()
    drill = import_module(f"tests.faults.{chosen.drill}")
    return int(drill.main(chosen.options))


if __name__ == "__main__":
    sys.exit(main())
