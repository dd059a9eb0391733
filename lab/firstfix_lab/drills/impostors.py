"""Scans of moving robots in places that look alike: does a moving robot take one for another?

    firstfix-lab impostors [--count N] [--worlds NAME ...] [--seed N] [--root PATH] [--json FILE]

Each world is mapped without a trajectory. Scans are simulated with the robot's true motion (straight on,
turning by up to 120 degrees a second, or both) and are sent with the times of their points. An answer is
*false* if it is ``localized`` over 1 m or 10 degrees from the truth: the drill ends with an error. *Doubted*
ones do no harm to a robot: the best place is wrong and has a probability above 0.5, but no pose was given.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from firstfix.answer.localization import Localization, Verdict
from firstfix.transform import Matrix, pose_error
from firstfix_lab.checkout import ROOT

from .impostor_worlds import HOSPITAL, MOTIONS, ImpostorWorld, hospital, office, storeys

RIGHT_M, RIGHT_DEG = 1.0, 10.0
SURE = 0.5
COLUMNS = ("answers", "right", "ambiguous", "rejected", "false", "doubted")
WORLDS: dict[str, Callable[[], ImpostorWorld]] = {
    "office": lambda: office(0),
    "office 4": lambda: office(4),
    "hospital": hospital,
    "storeys": storeys,
}


@dataclass
class Table:
    """Counts by world and motion.

    Attributes:
        examples: what was false.
    """

    rows: dict[tuple[str, str], Counter[str]] = field(default_factory=dict)
    examples: list[str] = field(default_factory=list)

    def add(self, world: str, motion: str, answer: Localization, T_map_sensor: Matrix) -> None:
        """Count one answer.

        Args:
            T_map_sensor: (4, 4) the truth.
        """
        counts = self.rows.setdefault((world, motion), Counter())
        found = judged(answer, T_map_sensor)
        counts.update(["answers", *found])
        if "false" in found:
            off_m, off_deg = pose_error(T_map_sensor, answer.hypotheses[0].T_map_sensor)
            self.examples.append(
                f"{world}, {motion}: {np.round(T_map_sensor[:3, 3], 2).tolist()} localized {off_m:.2f} m and "
                f"{off_deg:.0f} degrees off, probability {answer.probability:.5f}"
            )

    def total(self, column: str) -> int:
        return sum(counts[column] for counts in self.rows.values())

    def __str__(self) -> str:
        lines = [f"{'world':12}{'motion':12}" + "".join(f"{name:>11}" for name in COLUMNS)]
        for (world, motion), counts in self.rows.items():
            lines.append(f"{world:12}{motion:12}" + "".join(f"{counts[name]:11,}" for name in COLUMNS))
        lines.append(f"{'all':24}" + "".join(f"{self.total(name):11,}" for name in COLUMNS))
        share = self.total("ambiguous") / max(self.total("answers"), 1)
        return "\n".join([*lines, f"{share:.1%} were ambiguous"])


def judged(answer: Localization, T_map_sensor: Matrix) -> list[str]:
    """The columns in which an answer counts."""
    if not answer.hypotheses:
        return ["rejected"]
    best = answer.hypotheses[0]
    off_m, off_deg = pose_error(T_map_sensor, best.T_map_sensor)
    is_right = off_m <= RIGHT_M and off_deg <= RIGHT_DEG
    if answer.verdict is Verdict.LOCALIZED:
        return ["right" if is_right else "false"]
    return [answer.verdict.value, *(["doubted"] if not is_right and best.probability > SURE else [])]


def run(world: ImpostorWorld, name: str, table: Table, *, count: int, seed: int) -> None:
    """Ask for ``count`` scans of each motion."""
    for number, motion in enumerate(MOTIONS):
        for scan, T_map_sensor in world.scans(motion, count, np.random.default_rng([seed, number])):
            table.add(name, motion, world.localizer.localize(scan), T_map_sensor)


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(prog="firstfix-lab impostors", description=__doc__.split("\n\n")[0])
    parser.add_argument("--count", type=int, default=260, help="scans of each motion in each world")
    parser.add_argument("--worlds", nargs="+", choices=WORLDS, default=list(WORLDS))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--root", type=Path, help="another checkout, with a .venv, whose code is tried")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the table here")
    chosen = parser.parse_args(arguments)
    if chosen.root:
        rest = [word for word in arguments if word not in ("--root", str(chosen.root))]
        line = [chosen.root / ".venv/bin/python", "-m", "firstfix_lab", "impostors", *rest]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "lab")])}
        return subprocess.run(line, env=environment, check=False).returncode
    table = Table()
    for name in chosen.worlds:
        if name == "hospital" and not HOSPITAL.exists():
            print(f"{name}: left out, {HOSPITAL.name} is missing")
            continue
        run(WORLDS[name](), name, table, count=chosen.count, seed=chosen.seed)
    print("\n".join(table.examples), table, sep="\n\n")
    if chosen.json:
        rows = {f"{world}, {motion}": dict(counts) for (world, motion), counts in table.rows.items()}
        chosen.json.write_text(json.dumps(rows) + "\n")
    return 1 if table.total("false") else 0
