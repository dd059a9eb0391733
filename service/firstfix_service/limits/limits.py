"""All that may hold or refuse a request: each limit's value and unit, what it protects, and its refusal.

A value that is a setting has the default of ``Settings``; an operator changes it as ``FIRSTFIX_`` and its
name. A refusal is a problem document with a status and a code: 413 `too_large`, 408 `deadline_exceeded`, 429
`rate_limited` or `quota_exceeded`, 503 `overloaded`. Threads by kind of work are in ``thread_pools``.
"""

from __future__ import annotations

import resource
from dataclasses import dataclass, fields, replace
from typing import Any

from ..security_check import exposed_at
from ..settings import Settings


def _setting(name: str) -> Any:
    return Settings.model_fields[name].default


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits of one service. What no setting changes may be read from the class."""

    # Connections (``connections``, ``http_server``). One beyond a limit takes the place of one that waits for
    # its caller; if none does, it gets 503. What is late is ended.
    max_connections: int = 4096  # even if more files may be open: each connection can use 128 KiB
    # Of one address: more push out its idle ones. Robots behind one address have a connection each, or two.
    max_connections_per_address: int = 256
    health_connections: int = 16  # above the limit, for health requests only
    reserved_files: int = 256  # open files for the store, query workers, zenoh and logs
    head_timeout_s: float = 20.0  # a head has at most 64 KiB: 3 kB/s
    body_timeout_s: float = 30.0  # and the time for ``min_bytes_per_s``; for the next piece of a file
    answer_timeout_s: float = _setting("answer_timeout_s")  # to read an answer, and ``min_bytes_per_s``
    min_bytes_per_s: int = 500  # of a body, and of an answer: the slowest mobile networks are faster
    longest_answer_s: float = 300.0  # for a long answer to be taken in: its bytes stay in memory until then
    # Longer than the 60 s for which proxies commonly keep idle connections: a proxy closes first, so none of
    # its requests meets a connection that is being closed. An idle connection costs little: it makes room for
    # others.
    keep_alive_s: float = 75.0
    linger_s: float = 5.0  # for a caller that still sends to see an early answer
    linger_bytes: int = 4 << 20
    linger_body_bytes: int = 65 << 20  # of a body of declared length: clients send files of 64 MiB in a form
    linger_bytes_per_s: int = 128 << 10  # a body that comes faster has more time
    max_head_bytes: int = 64 << 10
    max_headers: int = 100
    max_pipelined: int = 100  # requests that wait for an earlier answer

    # Turns of all who ask (``turns``), in any way but as a query: a request beyond the rate waits.
    requests_per_s: float = 50.0  # of one caller or one address: they then take a few percent of a core
    request_burst_s: float = 2.0  # a page, its files and what it shows come at once
    max_wait_s: float = 5.0  # of a caller: as many connections as one address may have keep to the rate
    max_unauthenticated_wait_s: float = 2.0  # people who open the console may share their address with others
    max_probe_wait_s: float = 0.5  # probes give up after a second, and one may share its address, too
    max_waiting_refusals: int = 250  # of a caller, over zenoh: as many connections wait over HTTP

    # Rates of one caller (``rate``): 429. 0: no limit.
    localize_per_s: float = 50.0  # queries; the default holds where other machines reach the service
    localize_burst_s: float = 5.0
    builds_per_hour: float = 60.0  # or more, if a caller may have so many minutes that each build takes one
    changes_per_min: float = 60.0  # of each map: each change stays in its log for ever
    new_keys_per_s: float = 0.2  # of an address: keys that the last listing did not have are looked up
    new_keys_burst: float = 5.0
    all_new_keys_per_s: float = 5.0  # of all addresses together: each is two requests to the store
    all_new_keys_burst: float = 20.0
    auth_failures_per_min: float = 60.0  # of an address: nobody guesses 256 bits, but a guess is a log line
    max_names: int = 10_000  # whose requests are counted: the one seen longest ago is forgotten first

    # Bytes in memory (``byte_budget``): 413 where one has too many, 503 where all have, 429 where its caller
    # has.
    max_body_bytes: int = _setting("max_body_bytes")  # of a query, as received and decompressed
    max_inflight_bytes: int = _setting("max_inflight_bytes")  # of all queries; one caller has at most half
    max_json_bytes: int = 1 << 20  # of a body that is no query and no file
    max_unsent_bytes: int = _setting("max_unsent_bytes")  # of large answers; a caller has at most a quarter
    small_answer_bytes: int = 1 << 20  # the last eighth is kept for those below it, such as metrics and lists

    # Queries (``localize.query_gate``, ``fair_queue``, ``slow_share``): 503, or a turn later.
    workers: int = _setting("workers")
    queue_size: int = _setting("queue_size")  # queries that wait
    slow_query_s: float = 0.25  # one that should take longer leaves a worker to other callers and maps
    recent_s: float = 60.0  # who was answered within this time may ask again at any moment

    # Replies over zenoh (``zenoh_api.replies``), each of which may wait for a caller that does not read: 503.
    max_replies: int = 128  # a thread each, started when it is needed
    max_replies_per_caller: int = 64
    max_waiting_replies: int = 1024  # for a thread
    pending_factor: int = 8  # zenoh queries that are taken in, as a multiple of the places in the gate

    # Long requests under way, of all and of one caller (``concurrency_limit``): 503 and 429.
    max_upload_streams: int = 16  # 32 MiB of memory each
    max_upload_streams_per_caller: int = 4
    max_event_streams: int = 128  # pages of the console, and who waits for a build
    max_event_streams_per_caller: int = 16

    # What lasts: 413, 429, 503, and 507 where a disk is full.
    max_upload_bytes: int = _setting("max_upload_bytes")
    file_bytes_per_s: int = 1024  # of an uploaded file; below it, nothing but an attack
    file_timeout_s: float = 6 * 3600.0  # 20 GB at 1 MB/s; over a slower link a file comes in several requests
    max_open_uploads: int = 256  # each begin lists all of them
    max_open_uploads_per_caller: int = 32
    largest_files_per_caller: int = 5  # times ``max_upload_bytes``: of the open uploads of one caller
    min_free_bytes: int = 1 << 30  # on the disks of the work folder and of a file store, for logs and records
    build_minutes_per_day: float = 1440.0  # of one caller; the default holds where other machines reach it
    max_builds_per_caller: int = 50  # that wait or run: each is looked at when the next one comes

    @classmethod
    def of(cls, settings: Settings, open_files: int | None = None) -> Limits:
        """The limits of a service with these settings.

        Args:
            open_files: limit of this process; default: the system's.
        """
        return cls().with_settings(settings, open_files)

    def with_settings(self, settings: Settings, open_files: int | None = None) -> Limits:
        """These limits where the settings and the machine say nothing else, see ``of``."""
        if open_files is None:
            open_files = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
        connections, exposed = self._connections(open_files), bool(exposed_at(settings))
        minutes = _chosen(settings.build_minutes_per_day, self.build_minutes_per_day, exposed)
        return replace(
            self,
            **{name: getattr(settings, name) for name in _SETTINGS},
            max_connections=connections,
            max_connections_per_address=min(self.max_connections_per_address, max(1, connections // 2)),
            localize_per_s=_chosen(settings.localize_per_s, self.localize_per_s, exposed),
            changes_per_min=self.changes_per_min if exposed else 0.0,
            build_minutes_per_day=minutes,
            builds_per_hour=max(self.builds_per_hour, minutes / 24) if minutes else 0.0,
            max_builds_per_caller=self.max_builds_per_caller if minutes else 0,
        )

    def _connections(self, open_files: int) -> int:
        """Number of connections for which files can be open."""
        if open_files == resource.RLIM_INFINITY:
            return self.max_connections
        left = open_files - min(open_files // 2, self.reserved_files) - self.health_connections
        return min(max(1, left), self.max_connections)


_SETTINGS = ({one.name for one in fields(Limits)} & set(Settings.model_fields)) - {
    "localize_per_s",
    "build_minutes_per_day",
}


def _chosen(given: float | None, default: float, exposed: bool) -> float:
    """The given limit, or the default where other machines reach the service; 0: no limit."""
    return given if given is not None else default if exposed else 0.0
