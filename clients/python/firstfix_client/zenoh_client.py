"""The zenoh client: the same fix, the same answer bytes, without an address to know."""

from __future__ import annotations

import json
import random
import time
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any

from firstfix.errors import FirstfixError, InvalidOption
from firstfix.ids import check_map_id
from firstfix.localization import Localization
from firstfix.options import LocalizeOptions
from firstfix.query_parameters import QueryParameters
from firstfix.scan_sequence import ScanSequence

from .credential import credential
from .errors import PASSING, ServiceUnreachable, error_of_problem
from .live_replicas import LiveReplicas
from .retry import Deadline, RetryPolicy
from .scan_body import BodyForm, Encoding, ScanLike, encoded

MAX_MESSAGE_BYTES = 16 << 20


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
        """As ``Client.localize``, in one named map. A descriptor needs its parameters given here: the
        replicas serve no manifests over zenoh.

        Raises:
            InputError: the scan or an option cannot be used.
            NotFound: the replicas serve no such version.
            ServiceUnreachable: no replica of this map answered.
        """
        check_map_id(map_id)  # a key expression with wildcards would ask every map
        wanted, form = (
            options or LocalizeOptions(),
            replace(self._form, encoding=encoding, parameters=parameters),
        )
        media_type, body = encoded(scan, form, wanted.gravity)
        told = wanted.to_strings()
        deadline = Deadline(self._timeout_s)
        tried: set[str] = set()
        attempt = 0
        while True:
            attempt += 1
            key, others = self._choose(map_id, tried)
            tried.add(key)
            left_s = deadline.remaining_s()
            # a replica that hangs must leave time for another one
            reply = self._ask(key, media_type, body, told, left_s / 2 if others else left_s)
            if isinstance(reply, Localization):
                return reply
            wait_s = self._retry.wait_s(attempt)
            passing = isinstance(reply, (*PASSING, ServiceUnreachable))
            if not passing or attempt >= self._retry.attempts:
                raise reply
            if not deadline.allows(wait_s):
                raise deadline.exceeded() if isinstance(reply, ServiceUnreachable) else reply
            if not others:  # everybody was asked: give them time, then ask all of them again
                time.sleep(wait_s)
                tried.clear()

    def _choose(self, map_id: str, tried: set[str]) -> tuple[str, bool]:
        """A key to ask, and whether there is another one after it."""
        shared = f"firstfix/{map_id}/localize"
        fresh = [key for key in self._replicas.of(map_id) if key not in tried]
        if fresh:
            return random.choice(fresh), True
        return shared, False

    def _ask(
        self, key: str, media_type: str, body: bytes, parameters: dict[str, str], timeout_s: float
    ) -> Localization | FirstfixError | ServiceUnreachable:
        told = {"deadline_ms": str(max(1, int(timeout_s * 1000))), **parameters}
        replies = self._session.get(
            self._zenoh.Selector(key, told),
            payload=body,
            encoding=media_type,
            attachment=self._api_key,
            timeout=timeout_s,
        )
        for reply in replies:
            if reply.ok is None:
                # without a problem document it is zenoh's own word: a timeout
                problem = error_of_problem(reply.err.payload.to_bytes())
                return problem or ServiceUnreachable(f"no answer on {key} within {timeout_s:.3g} s")
            try:
                return Localization.from_mapping(json.loads(reply.ok.payload.to_bytes()))
            except (ValueError, KeyError, TypeError, AttributeError) as error:
                return FirstfixError(f"{key} answered nothing this client can read: {error!r}")
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
