"""Reads ``sessions.yaml``: the list of the sessions in a folder."""

from __future__ import annotations

from pathlib import Path, PurePosixPath

import numpy as np
import yaml
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from firstfix.errors import MalformedData, NotFound, TooLarge

from ..read_map.rigid import rigid_matrices

FILE_NAMES = ("sessions.yaml", "sessions.yml", "sessions.json")
MAX_BYTES = 64 << 10
MAX_SESSIONS = 16
MAX_PATH = 200


class Session(BaseModel):
    """One session, as the file describes it.

    Attributes:
        source: path below the folder, to a map file or to the folder of a SLAM package.
        trajectory: path below the folder, to the poses of the mapping run; None: those in the source, if any.
        T_map_session: rows of the 4x4 transform from the session's coordinates to the map's; None: the build
            finds it.
        align: True: the build finds the transform.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    source: str = Field(min_length=1, max_length=MAX_PATH)
    trajectory: str | None = Field(None, min_length=1, max_length=MAX_PATH)
    T_map_session: tuple[tuple[float, float, float, float], ...] | None = Field(
        None, min_length=4, max_length=4
    )
    align: bool | None = None

    @field_validator("source", "trajectory")
    @classmethod
    def _below_the_folder(cls, value: str | None) -> str | None:
        if value is None:
            return None
        path = PurePosixPath(value)
        hidden = any(part.startswith(".") for part in path.parts)  # these do not count for the stage cache
        if hidden or not path.parts or path.is_absolute() or "\\" in value or "\0" in value:
            raise ValueError(f"{value!r} is not a path below the folder")
        return value

    @model_validator(mode="after")
    def _one_way(self) -> Session:
        if self.T_map_session is not None:
            if self.align:
                raise ValueError("give either T_map_session or align: true")
            try:
                rigid_matrices(np.array([self.T_map_session]))
            except MalformedData:
                raise ValueError("T_map_session is not a rigid transform") from None
        elif self.align is False:
            raise ValueError("align: false needs T_map_session")
        return self

    @property
    def given(self) -> NDArray[np.float64] | None:
        """T_map_session (4, 4), or None."""
        if self.T_map_session is None:
            return None
        T: NDArray[np.float64] = rigid_matrices(np.array([self.T_map_session]))[0]
        return T


class _Description(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    sessions: tuple[Session, ...] = Field(min_length=1, max_length=MAX_SESSIONS)

    @model_validator(mode="after")
    def _distinct(self) -> _Description:
        named = [PurePosixPath(session.source) for session in self.sessions]
        if len(set(named)) < len(named):
            raise ValueError("two sessions have the same source")
        return self


def description_in(source: Path) -> Path | None:
    """Path of the file that lists a folder's sessions; None: the folder is one map."""
    return next((source / name for name in FILE_NAMES if (source / name).is_file()), None)


def read_description(path: Path) -> tuple[Session, ...]:
    """The sessions of a folder, in order. The first one's frame is the map's, unless it has a transform.

    Raises:
        MalformedData: the file does not match ``Session``, or a path leads out of the folder.
        NotFound: there is no file at a path.
        TooLarge: the file is over 64 KB.
    """
    if path.stat().st_size > MAX_BYTES:
        raise TooLarge(f"{path.name}: over {MAX_BYTES} bytes")
    try:
        sessions = _Description.model_validate(yaml.safe_load(path.read_bytes())).sessions
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        raise MalformedData(f"{path.name}: {' '.join(str(error).split())[:300]}") from None
    except ValidationError as error:
        problems = "; ".join(
            f"{'.'.join(str(part) for part in problem['loc'])}: {problem['msg']}"
            for problem in error.errors()
        )
        raise MalformedData(f"{path.name}: {problems[:1000]}") from None
    for session in sessions:
        for named in (session.source, session.trajectory):
            if named is not None:
                _check(path.parent, named)
    return sessions


def _check(folder: Path, named: str) -> None:
    """Check the target of a path, because a link could lead out of the folder."""
    target = (folder / named).resolve()
    if not target.is_relative_to(folder.resolve()):
        raise MalformedData(f"{named}: it leads out of the folder")
    if not target.exists():
        raise NotFound(f"{named}: no such file")
