"""The zenoh client: it finds the replicas by itself, and gets the same answers as over HTTP."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import Prior
from firstfix.errors import FirstfixError, InvalidOption, pip_install
from firstfix.ids import check_map_id, check_robot_name
from firstfix.scan.sequence import ScanSequence
from firstfix.wire.endpoints import ENDPOINT_FORM, Links, said_by_zenoh
from firstfix.wire.signature import SigningKey

from .calls import BuildCalls, MapCalls
from .drivers import blocking
from .drivers.live_replicas import LiveReplicas, ReplicaRoute, SignedRoute
from .drivers.zenoh_ask import ZenohAsk, ZenohQuery
from .errors import ServiceUnreachable
from .policies import HedgePolicy, RetryPolicy
from .records import MapInfo, ReplicaInfo
from .steps.http import HttpSteps, credential, sent_headers
from .steps.localize import LocalizeSteps, options_of
from .steps.scan_body import BodyForm, Encoding, ScanLike
from .steps.send import Deadline, Hedging, send
from .steps.step import Answer, Steps, work
from .version_watch import VersionWatch

if TYPE_CHECKING:
    from firstfix.scan.descriptor_parameters import DescriptorParameters

    from .drivers.blocking_http import BlockingService

MAX_MESSAGE_BYTES = 16 << 20
MAPS = "firstfix/maps"
LOOK_S = 1.0


class ZenohClient(MapCalls, BuildCalls):
    """Client of firstfix replicas over zenoh. Thread-safe. Close it, or use it in a ``with``.

    A query goes to a live replica chosen at random: the key that all replicas share would always give it
    to the same one. The shared key is used when no replica announces itself. Another replica is asked when a
    reply takes long, or is empty because the replica died. If each map is held by some of the replicas,
    only those that hold it are asked.

    Replicas answer ``localize``, ``maps``, ``replicas`` and ``watch_versions`` over zenoh. Every other method
    of ``Client`` goes over HTTP, to ``url``.

    Args:
        endpoint: of a router or replica, such as ``tcp/localhost:7447``; None: multicast scouting, or the
            endpoints of the config.
        config: a zenoh configuration file (JSON5), for TLS, users and so on.
        url: of the service over HTTP, as in ``Client``; None: methods that need it raise InvalidOption.
        api_key: as in ``Client``. Queries are signed with it, and only replies that the service has signed
            are taken; the key itself is never sent over zenoh. A token of another form has to be sent as it
            is: it is refused unless the endpoints are on this machine or speak TLS.
        hedge: when another replica is asked because the first is slow; False: never.
        timeout_s, retry, resolution_m, voxel_m: as in ``Client``.

    Raises:
        InvalidOption: the config or the URL cannot be used, or a token would be sent where others read along.
        ServiceUnreachable: nothing listens at the endpoint.
        ModuleNotFoundError: the extra ``zenoh`` is not installed.
    """

    def __init__(
        self,
        endpoint: str | None = None,
        *,
        config: Path | str | None = None,
        url: str | Sequence[str] | None = None,
        timeout_s: float = 10.0,
        retry: RetryPolicy | None = None,
        hedge: HedgePolicy | bool = True,
        resolution_m: float | None = None,
        voxel_m: float | None = None,
        api_key: str | None = None,
    ) -> None:
        self._timeout_s = timeout_s
        self._retry = retry or RetryPolicy()
        policy = HedgePolicy() if hedge is True else hedge
        self._hedging = Hedging(policy) if policy else None
        self._zenoh = _zenoh()
        settings = self._settings(endpoint, config)
        given = _checked(credential(api_key), settings)
        form = BodyForm(resolution_m=resolution_m, voxel_m=voxel_m)
        self._service = None if url is None else _service(url, timeout_s, self._retry, form, api_key)
        self._fixes = LocalizeSteps(form, self._ask_body, None if url is None else self._look_up)
        try:
            self._session = self._zenoh.open(settings)
        except self._zenoh.ZError as error:
            raise ServiceUnreachable(
                f"no zenoh peer at {endpoint or config or 'scouting'}: {said_by_zenoh(error)}"
            ) from None
        self._replicas = LiveReplicas(self._session)
        self._ask = ZenohAsk(self._zenoh, self._session, given, self._replicas)

    def close(self) -> None:
        """Close the zenoh session and the HTTP connections."""
        self._session.close()
        if self._service is not None:
            self._service.close()

    def localize(
        self,
        scan: ScanLike | ScanSequence,
        *,
        map_id: str,
        prior: Prior | None = None,
        gravity: ArrayLike | None = None,
        options: LocalizeOptions | None = None,
        encoding: Encoding = "scan",
        parameters: DescriptorParameters | None = None,
        robot: str | None = None,
    ) -> Localization:
        """The pose of a scan in a map, see ``Client.localize``.

        Without a URL, the encoding ``descriptor`` needs ``parameters``: replicas do not send them over zenoh.

        Raises:
            InputError: the scan or an option cannot be used.
            NotFound: the replicas serve no such map or version.
            ServiceUnreachable: no replica answered.
        """
        form = BodyForm(encoding, parameters)
        steps = self._fixes.localize(scan, map_id, options_of(options, prior, gravity), form, robot)
        return blocking.run(steps, self._ask)

    def maps(self) -> list[MapInfo]:
        """The maps that the answering replica can localize in.

        Raises:
            ServiceUnreachable: no replica answered.
        """
        route = ReplicaRoute(MAPS, None)
        query = ZenohQuery(needs_credential=False)
        steps = send(lambda left_s: query, route, self._retry, Deadline(self._timeout_s))
        answer: Answer = blocking.run(steps, self._ask)
        return answer.parsed(lambda data: [MapInfo.from_mapping(item) for item in data["maps"]])

    def replicas(self) -> list[ReplicaInfo]:
        """The replicas that answer within a second. An empty list is not an error."""
        replies = self._session.get(
            "firstfix/@replicas/*", target=self._zenoh.QueryTarget.ALL, timeout=LOOK_S
        )
        found = []
        for reply in replies:
            if reply.ok is not None:
                answer = Answer(str(reply.ok.key_expr), reply.ok.payload.to_bytes())
                with suppress(FirstfixError):  # of somebody else, or of a later release
                    found.append(answer.parsed(ReplicaInfo.from_mapping))
        return sorted(found, key=lambda one: one.replica)

    def watch_versions(self, *, look_every_s: float = 10.0) -> VersionWatch:
        """An iterator over changes of the maps' active versions. Close it after use.

        Args:
            look_every_s: interval at which it asks for the versions, in case a notice was lost.
        """
        return VersionWatch(self._session, look_every_s)

    def _ask_body(
        self, body: bytes, media_type: str, map_id: str, options: LocalizeOptions, robot: str | None
    ) -> Steps[Localization]:
        names = [check_map_id(name) for name in map_id.split(",")] if map_id else []
        shared = f"firstfix/{names[0] if len(names) == 1 else '@any'}/localize"
        asked = options.to_strings() | ({"map": ",".join(names)} if len(names) > 1 else {})
        if robot is not None:
            asked["robot"] = check_robot_name(robot)

        def make(left_s: float) -> ZenohQuery:
            query = {"deadline_ms": str(max(1, int(left_s * 1000))), **asked}
            return ZenohQuery(query, body, media_type)

        route = (SignedRoute if self._ask.signs else ReplicaRoute)(shared, self._replicas)
        answer: Answer = yield from send(
            make, route, self._retry, Deadline(self._timeout_s), hedging=self._hedging
        )
        return answer.parsed(Localization.from_mapping)

    def _look_up(self, map_id: str) -> Steps[DescriptorParameters]:
        return work(lambda: self.descriptor_parameters(map_id))

    def _settings(self, endpoint: str | None, config: Path | str | None) -> Any:
        if not isinstance(config, (str, Path, type(None))):
            raise InvalidOption("zenoh config: not the path of a file")  # its text may hold a password
        try:
            settings = self._zenoh.Config() if config is None else self._zenoh.Config.from_file(str(config))
            settings.insert_json5("transport/link/rx/max_message_size", str(MAX_MESSAGE_BYTES))
            if endpoint is not None:
                settings.insert_json5("mode", '"client"')
                settings.insert_json5("connect/endpoints", json.dumps([endpoint]))
                settings.insert_json5("connect/timeout_ms", str(int(self._timeout_s * 1000)))
                settings.insert_json5("scouting/multicast/enabled", "false")
        except self._zenoh.ZError as error:
            form = "" if endpoint is None else f"; {ENDPOINT_FORM}"
            raise InvalidOption(f"zenoh config {config or endpoint}: {said_by_zenoh(error)}{form}") from None
        return settings


def _service(
    url: str | Sequence[str], timeout_s: float, retry: RetryPolicy, form: BodyForm, api_key: str | None
) -> BlockingService:
    from .drivers.blocking_http import BlockingService

    return BlockingService(HttpSteps(url, timeout_s, retry, None, form), sent_headers(api_key, None), None)


def _checked(given: str | None, settings: Any) -> str | None:
    """The credential if it may be used in such a session.

    Raises:
        InvalidOption: it cannot sign, and others may read along.
    """
    if given is None or SigningKey.of_api_key(given) is not None:
        return given
    links = Links.of(settings)
    if not links.are_encrypted:
        raise InvalidOption(
            "this credential is no API key (ffx_...), so it cannot sign queries, and sent as it is by "
            f"{', '.join(links.beyond)} others could take it: use an API key, TLS endpoints, or HTTPS"
        )
    return given


def _zenoh() -> Any:
    """The module. It is imported late because a robot that speaks HTTP does not need it."""
    try:
        import zenoh
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"ZenohClient needs eclipse-zenoh: {pip_install('./clients/python[zenoh]', '.[zenoh]')}",
            name=error.name,
        ) from None
    return zenoh
