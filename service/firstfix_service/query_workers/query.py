"""One query, from the edge to the engine and back: read and checked once, before its body; and its answer."""

from __future__ import annotations

import math
import pickle
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firstfix.answer.localization import Reason, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.catalog.version_prefix import check_prefix
from firstfix.decode import BodyDecoder, decoder_of
from firstfix.errors import InvalidOption, NotFound
from firstfix.formats.point_cloud import Body
from firstfix.ids import check_map_id
from firstfix.ros.media_types import POSE
from firstfix.wire.content_encoding import decompressor_of

from ..auth.principal import Principal
from ..limits.asker import Asker
from .answer_form import JSON, PARAMETERS, AnswerForm

MAP_PARAMETER = "map"
MAX_MAPS = 16  # that one query searches in full
REMEMBERED = 256  # heads: a robot asks the same way again and again
REMEMBERED_CHARS = 500  # in a longer head a prior or a motion is, which does not come again
CHOSEN_MAPS = 8  # of all that a caller sees, if a query names none and they are more than MAX_MAPS
SEVERAL_MAPS = "*"  # all searches of more than one map take turns as one
_NOBODY = Principal("")
_VERDICTS = {one.value: one for one in Verdict}  # to look one up takes longer by its class
_REASONS = {one.value: one for one in Reason}
_asker = lru_cache(REMEMBERED)(Asker)


@dataclass(frozen=True)
class ServedVersion:
    """A map version whose files are on this machine and verified.

    Attributes:
        provisional: coarse and little tested, until a full version takes its place.
    """

    map_id: str
    version: str
    directory: Path
    provisional: bool = False

    @cached_property
    def packed(self) -> bytes:
        """This version for the worker processes, as ``Query.packed``."""
        return pickle.dumps(self, pickle.HIGHEST_PROTOCOL)


class BodyFormat(NamedTuple):
    """Decompressor and decoder of one body. The service chooses them, a worker process applies them.

    Attributes:
        decompress: of a body, up to so many bytes.
            Raises MalformedData or TooLarge.
        decode: of a body without its content encoding.
            Raises UnsupportedFormat, MalformedData, TooLarge or InvalidScan.
    """

    decompress: Callable[[Body, int], Body]
    decode: BodyDecoder

    @classmethod
    @lru_cache(64)
    def of(cls, media_type: str, content_encoding: str | None) -> BodyFormat:
        """The format that the headers name.

        Raises:
            UnsupportedFormat: unknown media type or content encoding.
        """
        return cls(decompressor_of(content_encoding or ""), decoder_of(media_type))


@dataclass(frozen=True)
class EncodedAnswer:
    """Answer to a query: its bytes, and what the service records.

    Attributes:
        timings_ms: milliseconds by stage.
        json: the whole answer.
        pose_message: the ROS message, if it was asked for and there is a pose.
        T_map_body: (4, 4) pose for a geographic answer: the robot's if the sensor's mounting was given, else
            the sensor's. None if there is no pose or nobody asked.
        server_timing: the stages as a Server-Timing header, which browsers and proxies show.
    """

    verdict: Verdict
    reasons: tuple[Reason, ...]
    probability: float
    map_id: str
    map_version: str
    timings_ms: Mapping[str, float] = field(default_factory=dict)
    json: bytes = b""
    pose_message: bytes | None = None
    T_map_body: NDArray[np.float64] | None = None
    server_timing: bytes = b""

    @property
    def content(self) -> tuple[bytes, str]:
        """Bytes and media type: JSON, if there is no pose message."""
        return (self.json, JSON) if self.pose_message is None else (self.pose_message, POSE)

    @property
    def plain(self) -> tuple[Any, ...]:
        """The answer without classes: to find these takes a worker's message longer than all else."""
        reasons = [reason.value for reason in self.reasons]
        return tuple({**self.__dict__, "verdict": self.verdict.value, "reasons": reasons}.values())

    @staticmethod
    def of_plain(*plain: Any) -> EncodedAnswer:
        """The answer whose ``plain`` form this is."""
        answer = object.__new__(EncodedAnswer)  # as ``Query.filled``
        fields = answer.__dict__
        fields.update(zip(_ANSWER_FIELDS, plain, strict=True))
        fields["verdict"] = _VERDICTS[fields["verdict"]]
        fields["reasons"] = tuple([_REASONS[reason] for reason in fields["reasons"]])
        return answer


_ANSWER_FIELDS = tuple(EncodedAnswer.__dataclass_fields__)


@dataclass(frozen=True, eq=False)
class AsGiven:
    """Texts of a query as they came, for recorded queries, and the form that they ask for."""

    map_ids: tuple[str, ...] = ()
    media_type: str = ""
    content_encoding: str = ""
    options: Mapping[str, str] = field(default_factory=dict)
    form: AnswerForm = field(default_factory=AnswerForm)

    @cached_property
    def query(self) -> Query:
        """The query that these texts mean, without its maps: read once for all that have them.

        Raises:
            InvalidOption: an option or the version is malformed.
            UnsupportedFormat: unknown media type or content encoding.
        """
        options = LocalizeOptions.from_strings(self.options, (MAP_PARAMETER, *PARAMETERS))
        if options.version is not None:
            check_prefix(options.version)
        body_format = BodyFormat.of(self.media_type, self.content_encoding)
        packed = _packed(options, body_format, self.form)
        return Query((), options, body_format, form=self.form, given=self, packed=packed)


def _packed(options: LocalizeOptions, body_format: BodyFormat, form: AnswerForm) -> bytes:
    return pickle.dumps((options, body_format, form), pickle.HIGHEST_PROTOCOL)


_unpacked = lru_cache(2 * REMEMBERED)(pickle.loads)
_NOTHING = AsGiven()


@dataclass(frozen=True)
class Query:
    """A query whose head was checked.

    Attributes:
        map_ids: maps to search, each once. Where there are several, their places compete. Empty: they are
            still to be chosen from all that the caller sees.
        options: as the caller gave them.
        deadline: of ``time.monotonic``, one clock for all processes of a machine; infinite: none.
        form: how the caller wants the answer.
        packed: options, format and form for the worker processes: pickling them takes longer than the rest
            of a message. Empty: they are packed with the query.
        body: as it came, with its content encoding. The last three are filled in by ``LocalizeUseCase``.
        waits_ms: milliseconds that the query waited before, by stage. They become part of its timings.
        forms: of descriptors in which a worker describes the scan, instead of an answer.
        chosen_of: number of the maps that the service chose ``map_ids`` from; 0: the caller named them, or
            all that it sees are searched.
    """

    map_ids: tuple[str, ...]
    options: LocalizeOptions
    body_format: BodyFormat
    deadline: float = math.inf
    form: AnswerForm = field(default_factory=AnswerForm)
    caller: Principal = _NOBODY
    given: AsGiven = _NOTHING
    packed: bytes = b""
    body: Body = b""
    versions: tuple[ServedVersion, ...] = ()
    waits_ms: Mapping[str, float] = field(default_factory=dict)
    forms: tuple[str, ...] = ()
    chosen_of: int = 0

    @staticmethod
    def read(
        given: AsGiven,
        caller: Principal,
        served: Callable[[], Iterable[str]],
        arrived: float,
    ) -> Query:
        """Check the head of a query.

        Args:
            caller: has the scope ``localize``, and its rate limit allows the query: the transport checked
                both.
            served: returns the served maps. If none is named, all that the caller sees are searched, or
                those that resemble the scan most, if they are more than MAX_MAPS.
            arrived: ``time.monotonic`` when the query came. Its deadline counts from then.

        Raises:
            Forbidden: a named map is not one of the caller's.
            InvalidOption: an id, an option or the version is malformed, there are too many maps, or they are
                several for an option that belongs to one.
            UnsupportedFormat: unknown media type or content encoding.
            NotFound: no map is served yet.
        """
        for map_id in given.map_ids:
            caller.check_map(check_map_id(map_id))
        asked = given.query
        options = asked.options
        map_ids = tuple(dict.fromkeys(given.map_ids)) or tuple(filter(caller.sees, served()))
        if not map_ids:
            raise NotFound("no map is served yet")
        if len(map_ids) > MAX_MAPS and given.map_ids:
            raise InvalidOption(
                f"one query names up to {MAX_MAPS} maps, not {len(map_ids)}: name fewer, or none"
            )
        if len(map_ids) > 1 and (options.prior is not None or options.version is not None):
            raise InvalidOption("a prior and a version belong to one map: name it")
        if len(map_ids) > MAX_MAPS:
            map_ids = ()
        return asked.filled(map_ids=map_ids, deadline=options.deadline_from(arrived), caller=caller)

    @property
    def asker(self) -> Asker:
        """The one whose turn it takes."""
        return _asker(self.caller.name, self.map_ids[0] if len(self.map_ids) == 1 else SEVERAL_MAPS)

    def filled(self, **more: Any) -> Query:
        """The query with what is filled in later: ``dataclasses.replace`` takes a tenth of all its time."""
        query = object.__new__(type(self))
        query.__dict__.update(self.__dict__, **more)
        return query

    @property
    def plain(self) -> tuple[Any, ...]:
        """The part of the query that a worker process needs beside the body, as ``EncodedAnswer.plain``."""
        packed = self.packed or _packed(self.options, self.body_format, self.form)
        versions = [version.packed for version in self.versions]
        return packed, versions, self.map_ids, self.deadline, self.waits_ms, self.forms, self.chosen_of

    @staticmethod
    def of_plain(
        packed: bytes,
        versions: list[bytes],
        map_ids: tuple[str, ...],
        deadline: float,
        waits_ms: Mapping[str, float],
        forms: tuple[str, ...],
        chosen_of: int,
    ) -> Query:
        """The query whose ``plain`` form this is."""
        options, body_format, form = _unpacked(packed)
        return Query(
            map_ids,
            options,
            body_format,
            deadline,
            form,
            packed=packed,
            versions=tuple([_unpacked(version) for version in versions]),
            waits_ms=waits_ms,
            forms=forms,
            chosen_of=chosen_of,
        )


def remembered(read: Callable[..., AsGiven]) -> Callable[..., AsGiven]:
    """A reader of heads, given as texts or bytes, that reads a short one once for many queries."""
    read_again = lru_cache(REMEMBERED)(read)

    def read_or_remember(*texts: str | bytes) -> AsGiven:
        return (read_again if sum(map(len, texts)) <= REMEMBERED_CHARS else read)(*texts)

    return read_or_remember


def single_values(pairs: Sequence[tuple[str, str]]) -> dict[str, str]:
    """Query parameters by name.

    Raises:
        InvalidOption: one is given more than once: to take either would ignore the other.
    """
    twice = sorted(name for name, count in Counter(name for name, _ in pairs).items() if count > 1)
    if twice:
        raise InvalidOption(f"given more than once: {', '.join(twice)}")
    return dict(pairs)


def split_map_ids(maps: str) -> tuple[str, ...]:
    """The ids in a ``map`` parameter: one, several separated by commas, or none."""
    return tuple(maps.split(",")) if maps else ()
