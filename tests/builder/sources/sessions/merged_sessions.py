"""Sessions of one building merged by the first stage of a build, and the stages that it leaves."""

from __future__ import annotations

import json
import os
import shutil
from dataclasses import dataclass
from pathlib import Path

from tests.builder.sources.sessions.building import Session, building, session
from tests.builder.stages import stages_below

HERE = building(21)
ENDS_M = (0.0, 20.5)  # of the first session; the second one's overlap is 30 % of the building
FROM_M = 11.0


@dataclass(frozen=True)
class MergedSessions:
    """Two sessions and the stages of their map, to be read only.

    Attributes:
        source: the folder with ``sessions.yaml``.
        stages: of the session maps and of the merged one.
    """

    source: Path
    stages: Path

    @classmethod
    def make(cls, folder: Path) -> MergedSessions:
        """Merges them in an empty folder."""
        made = cls.of(folder)
        described(made.source, [first_session(), sparser_session()])
        read_map(made.source, folder)
        return made

    @classmethod
    def of(cls, folder: Path) -> MergedSessions:
        """Sessions of a folder in which they were made."""
        return cls(folder / "source", folder / "stages")

    def begin(self, work: Path) -> Path:
        """Makes a work folder whose builds continue from these stages."""
        shutil.copytree(self.stages, work / "stages", copy_function=os.link)
        return work


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
