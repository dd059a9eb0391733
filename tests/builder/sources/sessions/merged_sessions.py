"""Sessions of one building, described in a folder and merged by the first stage of a build."""

from __future__ import annotations

import json
from pathlib import Path

from tests.builder.sources.sessions.building import Session, building, session
from tests.builder.stages import stages_below

HERE = building(21)
ENDS_M = (0.0, 20.5)  # of the first session; the second one's overlap is 30 % of the building
FROM_M = 11.0


def first_session() -> Session:
    return session(HERE, *ENDS_M, seed=1)


def sparser_session() -> Session:
    """The other part of the building, in a cloud with larger distances between its points."""
    return session(HERE, FROM_M, 32.0, seed=2, step_m=0.14)


def read_map(folder: Path, work: Path, trajectory: Path | None = None) -> Path:
    """The files of the stage."""
    with stages_below(work) as stages:
        return stages.read_map(folder, trajectory).directory


def described(folder: Path, sessions: list[Session], **others: object) -> Path:
    """A folder with the sessions; ``others`` are of the last one's entry."""
    listed = []
    for number, one in enumerate(sessions):
        one.write(folder / f"s{number}")
        listed.append({"source": f"s{number}/cloud.npy", "trajectory": f"s{number}/poses.txt"})
    listed[-1] |= others
    (folder / "sessions.yaml").write_text(json.dumps({"sessions": listed}))
    return folder
