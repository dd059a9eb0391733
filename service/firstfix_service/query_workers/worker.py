"""A process that answers queries, one at a time.

    python -m firstfix_service.query_workers.worker QUERIES CONTROL BODIES CAPACITY MAX_DECODED SHARE

QUERIES and CONTROL are sockets to the service, BODIES is the file of its ``BodyMemory`` with CAPACITY bytes.
A body may have MAX_DECODED bytes without its content encoding. SHARE is that of the localized queries whose
sightings are counted. One socket carries queries; the other carries versions to load and to drop, and
sightings, so that these do not delay queries. The process ends when the service ends for any reason, because
the kernel then closes the sockets.
"""

from __future__ import annotations

import gc
import math
import os
import signal
import socket
import sys
import threading
import traceback
from collections.abc import Callable, Sequence
from dataclasses import astuple, replace
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from types import BuiltinFunctionType, FunctionType, MethodType, ModuleType

import numpy as np
import orjson

from firstfix.answer.localization import Localization
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer, localize_among
from firstfix.engine.map_choice.sought_scan import SoughtScan, describe_sought
from firstfix.engine.stopwatch import Stopwatch
from firstfix.errors import FirstfixError, VersionError
from firstfix.findings.scan_kinds import MAPS_LEFT_OUT
from firstfix.formats.point_cloud import Body
from firstfix.ros.cdr import MessageReader as CdrReader
from firstfix.ros.header import Stamp, read_stamp
from firstfix.ros.pose_message import to_pose_cdr

from .protocol import DROP, HELLO, LOAD, TAKE, WARM, MessageReader, mapped_bodies, reply_of, send_all
from .query import BodyFormat, EncodedAnswer, PoseFormat, Query, ServedVersion
from .sightings.counter import Sighted, SightingCounter
from .warm_up import at_low_priority, own_queries

SWITCH_S = 0.0005  # for which a query waits at most while the thread that counts sightings runs Python code
_NO_DATA = (type, ModuleType, FunctionType, BuiltinFunctionType, MethodType, str, bytes, int, float)
Offer = Callable[[ServedVersion, Localizer, object, Localization], None]


def load_localizer(directory: Path) -> Localizer:
    """Returns the localizer of a version's folder."""
    return Localizer(MapIndex.load(directory))


def describe_query(query: Query, max_decoded_bytes: int) -> SoughtScan:
    """Returns the description by which the maps of a query are chosen.

    Raises:
        InputError: the body or an option cannot be used.
    """
    plain = query.body_format.decompress(query.body, max_decoded_bytes)
    return describe_sought(query.body_format.decode(plain), query.options, query.forms)


def answer_query(
    query: Query, localizers: Sequence[Localizer], max_decoded_bytes: int, offer: Offer | None = None
) -> EncodedAnswer:
    """Returns the answer with its map version, the waits, and the time of decoding.

    Args:
        localizers: one for each of ``query.versions``.
        offer: gets the version that answered, its localizer, the scan and the answer.

    Raises:
        InputError: the body or an option cannot be used.
    """
    watch = Stopwatch()
    with watch.stage("decode"):
        plain = query.body_format.decompress(query.body, max_decoded_bytes)
        scan = query.body_format.decode(plain)
    by_map = {one.map_id: one for one in query.versions}
    if len(localizers) == 1:
        (answered,) = query.versions
        answer = localizers[0].localize(scan, query.options, query.deadline)
    else:
        maps = dict(zip(by_map, localizers, strict=True))
        answer = localize_among(maps, scan, query.options, query.deadline, likely_one=query.chosen_of > 0)
        # If no map is sure: the map of the best hypothesis, if there is one.
        answered = by_map[answer.hypotheses[0].map_id] if answer.hypotheses else query.versions[0]
    answer = answer.of_version(answered.map_id, answered.version, provisional=answered.provisional)
    if query.chosen_of > len(localizers):
        left_out = MAPS_LEFT_OUT.found({"searched": len(localizers), "maps": query.chosen_of})
        answer = replace(answer, findings=(*answer.findings, left_out))
    answer = replace(answer, timings_ms={**query.waits_ms, **watch.ms, **answer.timings_ms})
    if offer is not None:
        offer(answered, localizers[query.versions.index(answered)], scan, answer)
    message = _pose_message(answer, query.form.pose, query.body_format, plain)
    return encoded_answer(answer, message, geographic=query.form.geographic)


def _pose_message(
    answer: Localization, pose: PoseFormat | None, body_format: BodyFormat, plain: Body
) -> bytes | None:
    """The ROS message of a pose that was asked for. An answer without a pose has none.

    Its stamp, if none is given, is that of a PointCloud2; of other scans zero: "not known" in ROS.
    """
    if pose is None or answer.T_map_sensor is None:
        return None
    stamp = pose.stamp
    if stamp is None and body_format.is_point_cloud2:
        stamp = read_stamp(CdrReader("PointCloud2", plain))
    return to_pose_cdr(answer, stamp or Stamp(), pose.frame_id)


def encoded_answer(
    answer: Localization, pose_message: bytes | None = None, *, geographic: bool = False
) -> EncodedAnswer:
    """Returns the encoded form of an answer."""
    T_map_body = answer.T_map_sensor if answer.T_map_base is None else answer.T_map_base
    return EncodedAnswer(
        answer.verdict,
        answer.reasons,
        answer.probability,
        answer.map_id,
        answer.map_version,
        answer.timings_ms,
        to_json(answer),
        pose_message,
        T_map_body if geographic else None,
    )


def to_json(answer: Localization) -> bytes:
    """Returns the JSON form of an answer, the same on both transports.

    Raises:
        ValueError: a number is not finite.
    """
    if not _is_finite(answer):
        raise ValueError("an answer has a number that is not finite")
    return orjson.dumps(answer.to_mapping(), option=orjson.OPT_SERIALIZE_NUMPY)


def _is_finite(answer: Localization) -> bool:
    """Returns whether JSON can hold every number: orjson would write null for the others."""
    poses = [answer.T_map_sensor, answer.T_map_base, *(one.T_map_sensor for one in answer.hypotheses)]
    numbers = [answer.probability, *(one.probability for one in answer.hypotheses)]
    for finding in answer.findings:
        numbers += finding.numbers.values()
    if answer.scan is not None:
        numbers += [number for number in astuple(answer.scan) if number is not None]
    if answer.hint is not None:
        poses.append(answer.hint.T_sensor_goal)
        numbers += answer.hint.distance_m, answer.hint.turn_deg, answer.hint.separation
    for one in answer.hypotheses:
        if one.quality is not None:
            numbers += [number for number in astuple(one.quality) if number is not None]
    return (
        all(map(math.isfinite, numbers))
        and bool(np.isfinite([T for T in poses if T is not None]).all())
        and (answer.covariance is None or bool(np.isfinite(answer.covariance).all()))
        and all(
            math.isfinite(one.sigma) and bool(np.isfinite(one.direction).all()) for one in answer.degenerate
        )
        and (answer.twist is None or bool(np.isfinite(answer.twist).all()))
    )


class Localizers:
    """Loads versions and answers queries with them. Thread-safe.

    Args:
        load: makes the localizer of a version's folder.
        max_decoded_bytes: largest body without its content encoding.
        sightings: counts the queries that are localized; None: nothing is counted.
    """

    def __init__(
        self,
        load: Callable[[Path], Localizer],
        max_decoded_bytes: int,
        sightings: SightingCounter | None = None,
    ) -> None:
        self._load_files = load
        self._max_decoded_bytes = max_decoded_bytes
        self._sightings = sightings
        self._localizers: dict[ServedVersion, Localizer] = {}
        self._lock = threading.Lock()
        self._loads: dict[ServedVersion, threading.Lock] = {}
        self._warm: set[ServedVersion] = set()

    @property
    def loaded(self) -> tuple[ServedVersion, ...]:
        """The versions in memory, in the order in which they were loaded."""
        with self._lock:
            return tuple(self._localizers)

    def load(self, version: ServedVersion) -> int:
        """Loads a version; returns its bytes in memory, without the mapped files."""
        localizer = self._localizer(version)
        # FAISS reads its file into memory, which ``_private_bytes`` cannot see.
        held_by_faiss = sum(path.stat().st_size for path in version.directory.glob("*.faiss"))
        return _private_bytes(localizer) + held_by_faiss

    def warm_up(self, version: ServedVersion) -> int:
        """Asks a version about scans of its own map, once if it is loaded; returns their number.

        Raises:
            Exception: a query failed.
        """
        with self._lock:
            localizer = self._localizers.get(version)  # None: it was dropped meanwhile
        if version in self._warm or not isinstance(localizer, Localizer):
            return 0

        def ask_all() -> int:
            count = 0
            for query in own_queries(version, localizer.index):
                answer_query(query, [localizer], self._max_decoded_bytes)
                count += 1
            return count

        count = at_low_priority(ask_all)
        self._warm.add(version)
        return count

    def drop(self, version: ServedVersion) -> None:
        """Unloads a version."""
        self._warm.discard(version)
        with self._lock:
            self._localizers.pop(version, None)
            self._loads.pop(version, None)
        if self._sightings is not None:
            self._sightings.unload(version)

    def answer(self, query: Query) -> EncodedAnswer | SoughtScan:
        """Returns the answer to a query, or its description. Loads its versions if they are not loaded."""
        if query.forms:
            return describe_query(query, self._max_decoded_bytes)
        offer = None if self._sightings is None else self._sightings.offer
        localizers = [self._localizer(version) for version in query.versions]
        return answer_query(query, localizers, self._max_decoded_bytes, offer)

    def clear(self) -> None:
        """Unloads all versions."""
        with self._lock:
            self._localizers.clear()

    def _localizer(self, version: ServedVersion) -> Localizer:
        with self._lock:
            if version in self._localizers:
                return self._localizers[version]
            load_lock = self._loads.setdefault(version, threading.Lock())
        with load_lock:  # other threads wait for this load instead of repeating it
            with self._lock:
                if version in self._localizers:
                    return self._localizers[version]
            try:
                localizer = self._load_files(version.directory)
            except FirstfixError:
                raise
            except Exception as error:  # of any kind: the previous version must go on serving
                raise VersionError(f"version {version.version} cannot be loaded: {error!r}") from error
            with self._lock:
                self._localizers[version] = localizer
            return localizer


def _private_bytes(root: object) -> int:
    """Returns the bytes of all NumPy arrays reachable from an object, except arrays mapped from files.

    The pages of a mapped file are shared, and the kernel can drop them at any time.
    """
    seen: set[int] = set()
    waiting: list[object] = [root]
    total = 0
    while waiting:
        one = waiting.pop()
        if id(one) in seen or isinstance(one, _NO_DATA):
            continue
        seen.add(id(one))
        if isinstance(one, np.ndarray):
            if isinstance(one.base, np.ndarray):
                waiting.append(one.base)
            elif one.base is None:
                total += one.nbytes
        else:
            waiting.extend(gc.get_referents(one))
    return total


def main(
    queries: socket.socket,
    control: Connection,
    bodies: memoryview,
    counts_sightings: bool,
) -> None:
    """Answers queries until the service is gone."""
    for number in (signal.SIGINT, signal.SIGTERM):  # for the service, which still finishes queries
        signal.signal(number, signal.SIG_IGN)
    sightings = SightingCounter() if counts_sightings else None
    sys.setswitchinterval(SWITCH_S)
    localizers = Localizers(load_localizer, len(bodies), sightings)
    serve = partial(_serve_control, control, localizers, sightings)
    threading.Thread(target=serve, daemon=True, name="control").start()
    reader = MessageReader()
    while True:
        try:
            received = reader.receive(queries)
            if received is None:
                continue
            query, inline, shared_bytes = received
            good, value = _outcome(partial(_answer, localizers, query, inline, bodies[:shared_bytes]))
            del received, query, inline
            reader.forget()
            send_all(queries, reply_of(good, value))
            if sightings is not None:
                sightings.wake()
        except (EOFError, OSError):
            return


def _answer(localizers: Localizers, query: Query, inline: memoryview, shared: memoryview) -> object:
    return localizers.answer(replace(query, body=shared or inline))


def _serve_control(control: Connection, localizers: Localizers, sightings: SightingCounter | None) -> None:
    do: dict[str, Callable[[ServedVersion], object]] = {
        LOAD: localizers.load,
        WARM: localizers.warm_up,
        DROP: localizers.drop,
        HELLO: lambda _: None,
        TAKE: lambda _: Sighted() if sightings is None else sightings.take(),
    }
    try:
        while True:
            what, version = control.recv()
            control.send(_outcome(partial(do[what], version)))
    except (EOFError, OSError):
        os._exit(0)  # whatever the main thread does: nobody waits for it any more


def _outcome(work: Callable[[], object]) -> tuple[bool, object]:
    """Returns (True, result), (False, our error), or (False, traceback of a defect)."""
    try:
        return True, work()
    except FirstfixError as error:
        return False, type(error)(str(error))  # without its cause, which may not be picklable
    except Exception:
        return False, traceback.format_exc()


if __name__ == "__main__":
    number, control_number, file, max_body_bytes, counts_sightings = map(int, sys.argv[1:6])
    main(
        socket.socket(fileno=number),
        Connection(control_number),
        mapped_bodies(file, max_body_bytes),
        bool(counts_sightings),
    )
