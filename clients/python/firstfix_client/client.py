"""The blocking HTTP client."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import TracebackType
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import Prior
from firstfix.scan.sequence import ScanSequence

from .calls import BuildCalls, MapCalls
from .policies import HedgePolicy, RetryPolicy
from .steps.http import HttpSteps, sent_headers
from .steps.localize import options_of
from .steps.scan_body import BodyForm, Encoding, ScanLike

if TYPE_CHECKING:
    import httpx

    from firstfix.scan.descriptor_parameters import DescriptorParameters

    from .drivers.blocking_http import BlockingService


class Client(MapCalls, BuildCalls):
    """Client of a firstfix service over HTTP. Thread-safe. Close it, or use it in a ``with``.

    Every call ends within its timeout, retries included. It is tried again when a connection fails or
    breaks, or the service is busy (503): at once on another replica, after a wait on the same one.
    Besides the errors in its docstring, every method raises the service's own errors (``firstfix.errors``),
    DeadlineExceeded when the timeout is over, and ServiceUnreachable when the last try reached no service.

    Args:
        url: address of the service, such as ``http://localhost:8080``; several replicas as a list or
            separated by commas. The client picks one at random and keeps it until it fails.
        timeout_s: limit for one call. Uploads and builds have their own.
        retry: when to try again.
        hedge: when ``localize`` asks a second replica because the first is slow. The first answer wins and
            the other query is cancelled. None: ``HedgePolicy()`` if there are several URLs; True or a
            policy: with one URL too, since it may stand for many replicas; False: never.
        resolution_m, voxel_m: precision and thinning of whole scans, see ``firstfix.wire.scan.encode_scan``.
            The default keeps all points, to 1 cm, or to 2.5 cm in a range image; ``voxel_m=0.25`` saves
            most of the bytes on a thin link.
        api_key: an API key, or a token of the service's issuer; None: the environment's FIRSTFIX_API_KEY, if
            it is set. Redirects are never followed, so only the service gets it.
        headers: sent with every request.
        transport: replaces the network in tests.
    """

    def __init__(
        self,
        url: str | Sequence[str],
        *,
        timeout_s: float = 10.0,
        retry: RetryPolicy | None = None,
        hedge: HedgePolicy | bool | None = None,
        resolution_m: float | None = None,
        voxel_m: float | None = None,
        api_key: str | None = None,
        headers: Mapping[str, str] | None = None,
        transport: httpx.BaseTransport | None = None,
    ) -> None:
        from .drivers.blocking_http import BlockingService  # importing httpx takes as long as all the rest

        form = BodyForm(resolution_m=resolution_m, voxel_m=voxel_m)
        steps = HttpSteps(url, timeout_s, retry, hedge, form)
        self._service = BlockingService(steps, sent_headers(api_key, headers), transport)

    def __enter__(self) -> Client:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Closes the connections."""
        self._service.close()

    @property
    def _http(self) -> BlockingService:
        return self._service

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
    ) -> Localization:
        """Returns the pose of a scan in a map, or why there is none.

        "Not localized" is an answer without a pose, not an error.

        Args:
            scan: a Scan, (n, 3) points in metres in the sensor frame, the path of a scan file, or several
                scans with the motion between them. The pose is then that of the last scan.
            map_id: one map; several, separated by commas; or empty for all maps that are served. The best
                place in any of them wins.
            prior: where the robot is known to be.
            gravity: (3,) direction of gravity in the sensor frame (pointing down).
            options: everything that can be asked; ``prior`` and ``gravity`` replace its fields. Without a
                ``deadline_ms`` the service is told how long this client waits.
            encoding: ``range_image`` sends the whole scan in a ninth to a third of the bytes, 120k points
                in under 90 KB. ``compact`` sends under 10 KB and localizes as well as the whole scan.
                ``descriptor`` sends under 1.5 KB and gets candidates, never ``localized``.
            parameters: the map's, for the last two. A descriptor needs those of its one map. If they are
                not given, the client asks the service for them once, and again when the map changes.

        Raises:
            NotFound: no such map or version, or no such file.
            InputError: the scan or an option cannot be used.
        """
        form = BodyForm(encoding, parameters)
        return self._http.run(
            self._http.steps.fixes.localize(scan, map_id, options_of(options, prior, gravity), form)
        )

    def localize_body(
        self,
        body: bytes,
        media_type: str,
        *,
        map_id: str,
        options: LocalizeOptions | None = None,
        content_encoding: str | None = None,
        request_id: str | None = None,
    ) -> Localization:
        """Returns the answer to an encoded query, as ``localize`` does. The bytes are sent unchanged.

        Args:
            media_type, content_encoding: format of the bytes, see clients/PROTOCOL.md.
            request_id: id of the query in the service's log.
        """
        return self._http.run(
            self._http.steps.ask(
                body, media_type, map_id, options or LocalizeOptions(), content_encoding, request_id
            )
        )
