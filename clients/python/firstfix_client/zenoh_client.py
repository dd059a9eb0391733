"""The zenoh client: the same fix, the same answer bytes, without an address to know."""

from __future__ import annotations

import json
import random
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar

from firstfix.errors import FirstfixError, InvalidOption
from firstfix.ids import check_map_id
from firstfix.localization import Localization
from firstfix.options import LocalizeOptions
from firstfix.query_parameters import QueryParameters
from firstfix.scan_sequence import ScanSequence

from .credential import credential
from .errors import PASSING, ServiceUnreachable, error_of_problem
from .live_replicas import LiveReplicas
from .records import MapInfo
from .replica_info import ReplicaInfo
from .retry import Deadline, RetryPolicy
from .scan_body import BodyForm, Encoding, ScanLike, encoded
from .version_watch import VersionWatch

T = TypeVar("T")
MAX_MESSAGE_BYTES = 16 << 20
MAPS = "firstfix/maps"
LOOK_S = 1.0


class ZenohClient:
    """Asks firstfix replicas over zenoh. Thread-safe; close it, or use it in a ``with``.

    A query goes to a live replica chosen at random, since the key that replicas share gives them to
    one of them only; to the shared key when no replica shows itself; and to another one when a reply
    stays empty, as it does when a replica dies at work.

    Args:
        endpoint: of a router or replica, such as ``tcp/localhost:7447``; None: multicast scouting, or
            what the config says.
        config: a zenoh configuration file (JSON5), for TLS, users and so on.
        api_key: as in ``Client``; it travels as the query's attachment.
        timeout_s, retry, resolution_m, voxel_m: as in ``Client``.

    Raises:
        InvalidOption: the config cannot be used.
        ServiceUnreachable: nothing listens at the endpoint.
        ModuleNotFoundError: the extra ``firstfix[zenoh]`` is not installed.
    """

    def __init__(
        self,
        endpoint: str | None = None,
        *,
        config: Path | str | None = None,
        timeout_s: float = 10.0,
        retry: RetryPolicy | None = None,
        resolution_m: float = 0.01,
        voxel_m: float | None = None,
        api_key: str | None = None,
    ) -> None:
        self._timeout_s = timeout_s
        self._api_key = credential(api_key)
        self._retry = retry or RetryPolicy()
        self._form = BodyForm(resolution_m=resolution_m, voxel_m=voxel_m)
        self._zenoh = _zenoh()
        settings = self._settings(endpoint, config)
        try:
            self._session = self._zenoh.open(settings)
        except self._zenoh.ZError as error:
            raise ServiceUnreachable(f"no zenoh at {endpoint or config or 'scouting'}: {error}") from None
        self._replicas = LiveReplicas(self._session)

    def __enter__(self) -> ZenohClient:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        self._session.close()

    def localize(
        self,
        scan: ScanLike | ScanSequence,
        *,
        map_id: str,
        options: LocalizeOptions | None = None,
        encoding: Encoding = "scan",
        parameters: QueryParameters | None = None,
    ) -> Localization:
        """As ``Client.localize``. A descriptor needs its parameters given here: the replicas serve no
        manifests over zenoh.

        Args:
            map_id: one map, several separated by commas, or empty: all that are served. Where there are
                several, their places compete.

        Raises:
            InputError: the scan or an option cannot be used.
            NotFound: the replicas serve no such map or version.
            ServiceUnreachable: no replica answered.
        """
        names = [check_map_id(name) for name in map_id.split(",")] if map_id else []
        shared = f"firstfix/{names[0] if len(names) == 1 else '@any'}/localize"
        wanted = options or LocalizeOptions()
        form = replace(self._form, encoding=encoding, parameters=parameters)
        media_type, body = encoded(scan, form, wanted.gravity)
        asked = wanted.to_strings() | ({"map": ",".join(names)} if len(names) > 1 else {})

        def ask(key: str, left_s: float) -> Any:
            told = {"deadline_ms": str(max(1, int(left_s * 1000))), **asked}
            return self._first_answer(key, left_s, told, payload=body, encoding=media_type)

        def choose(tried: set[str]) -> str:
            fresh = [key for key in self._replicas.of(shared) if key not in tried]
            return random.choice(fresh) if fresh else shared

        return self._retried(shared, choose, ask, Localization.from_mapping)

    def maps(self) -> list[MapInfo]:
        """Every map that the replica which answers can localize in.

        Raises:
            ServiceUnreachable: no replica answered.
        """
        return self._retried(
            MAPS,
            lambda tried: MAPS,
            self._first_answer,
            lambda data: [MapInfo.from_mapping(item) for item in data["maps"]],
        )

    def replicas(self) -> list[ReplicaInfo]:
        """Every replica that answers within a second; none is no error."""
        replies = self._session.get(
            "firstfix/@replicas/*", target=self._zenoh.QueryTarget.ALL, timeout=LOOK_S
        )
        found = [json.loads(reply.ok.payload.to_bytes()) for reply in replies if reply.ok is not None]
        return sorted((ReplicaInfo.from_mapping(item) for item in found), key=lambda one: one.replica)

    def watch_versions(self, *, look_every_s: float = 10.0) -> VersionWatch:
        """Changes of the maps' active versions, as they happen: an iterator that is to be closed.

        Args:
            look_every_s: how often it makes sure that no notice was lost.
        """
        return VersionWatch(self._session, look_every_s)

    def _retried(
        self,
        shared: str,
        choose: Callable[[set[str]], str],
        ask: Callable[[str, float], bytes | FirstfixError | ServiceUnreachable],
        read: Callable[[Any], T],
    ) -> T:
        """Asks one key after the other until somebody answers, or the timeout or the attempts are over.

        Args:
            shared: the key of all of them, the last one to be asked.
            choose: a key that is not among those that were asked, else the shared one.
        """
        deadline = Deadline(self._timeout_s)
        tried: set[str] = set()
        attempt = 0
        while True:
            attempt += 1
            key = choose(tried)
            others = key != shared
            tried.add(key)
            left_s = deadline.remaining_s()
            # a replica that hangs must leave time for another one
            reply = ask(key, left_s / 2 if others else left_s)
            if isinstance(reply, bytes):
                try:
                    return read(json.loads(reply))
                except (ValueError, KeyError, TypeError, AttributeError) as error:
                    raise FirstfixError(f"{key} answered nothing this client can read: {error!r}") from None
            wait_s = self._retry.wait_s(attempt)
            passing = isinstance(reply, (*PASSING, ServiceUnreachable))
            if not passing or attempt >= self._retry.attempts:
                raise reply
            if not deadline.allows(wait_s):
                raise deadline.exceeded() if isinstance(reply, ServiceUnreachable) else reply
            if not others:  # everybody was asked: give them time, then ask all of them again
                time.sleep(wait_s)
                tried.clear()

    def _first_answer(
        self, key: str, timeout_s: float, parameters: Mapping[str, str] | None = None, **sent: Any
    ) -> bytes | FirstfixError | ServiceUnreachable:
        selector = self._zenoh.Selector(key, dict(parameters or {}))
        for reply in self._session.get(selector, timeout=timeout_s, attachment=self._api_key, **sent):
            if reply.ok is not None:
                return reply.ok.payload.to_bytes()
            # without a problem document it is zenoh's own word: a timeout
            problem = error_of_problem(reply.err.payload.to_bytes())
            return problem or ServiceUnreachable(f"no answer on {key} within {timeout_s:.3g} s")
        return ServiceUnreachable(f"nobody answers on {key}")

    def _settings(self, endpoint: str | None, config: Path | str | None) -> Any:
        try:
            settings = self._zenoh.Config() if config is None else self._zenoh.Config.from_file(str(config))
            settings.insert_json5("transport/link/rx/max_message_size", str(MAX_MESSAGE_BYTES))
            if endpoint is not None:
                settings.insert_json5("mode", '"client"')
                settings.insert_json5("connect/endpoints", json.dumps([endpoint]))
                settings.insert_json5("connect/timeout_ms", str(int(self._timeout_s * 1000)))
                settings.insert_json5("scouting/multicast/enabled", "false")
        except self._zenoh.ZError as error:
            raise InvalidOption(f"zenoh config {config or endpoint}: {error}") from None
        return settings


def _zenoh() -> Any:
    """The module, imported late: a robot that speaks HTTP does without it."""
    try:
        import zenoh
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "ZenohClient needs the extra: pip install 'firstfix[zenoh]'", name=error.name
        ) from None
    return zenoh
