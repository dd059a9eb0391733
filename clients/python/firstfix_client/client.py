"""The HTTP client: a fix from a running service, as a typed answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import TracebackType
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import Prior
from firstfix.scan.sequence import ScanSequence

from .build_calls import BuildCalls
from .hedge import HedgePolicy
from .http_steps import HttpSteps, sent_headers
from .localize_steps import options_of
from .map_calls import MapCalls
from .retry import RetryPolicy
from .scan_body import BodyForm, Encoding, ScanLike

if TYPE_CHECKING:
    import httpx

    from firstfix.scan.descriptor_parameters import DescriptorParameters

    from .blocking_service import BlockingService


class Client(MapCalls, BuildCalls):
    """Asks a firstfix service over HTTP. Thread-safe; close it, or use it in a ``with``.

    Every call ends within its timeout, retries included: connections that fail or break and services that
    say "busy" (503) are tried again, elsewhere at once and at the same place after growing, random waits.
    Besides what its docstring lists, every method raises the service's own error (``firstfix.errors``),
    DeadlineExceeded when the timeout is over, and ServiceUnreachable when the last try reached no service.

    Args:
        url: of the service, such as ``http://localhost:8080``; of several replicas as a list, or with commas
            between them. One of them, at random at first, is asked until it fails.
        timeout_s: of a call as a whole; uploads and waiting for builds have their own.
        retry: when to try again.
        hedge: when ``localize`` asks a second replica because the first is slow; the first answer wins and
            the other query is cancelled. None: by ``HedgePolicy()`` if there are several URLs; True or a
            policy: also if there is one, which may stand for many replicas; False: never.
        resolution_m, voxel_m: how whole scans are sent, see ``firstfix.wire.scan.encode_scan``. The default
            is what the sensor saw, to 1 cm, or to 2.5 cm in a range image; ``voxel_m=0.25`` saves most of the
            bytes on a thin link.
        api_key: an API key or a token of the service's issuer; None: FIRSTFIX_API_KEY of the environment, if
            it is there. Redirects are never followed, so nobody but the service gets it.
        headers: sent with every request.
        transport: in place of the network, for tests.
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
        from .blocking_service import BlockingService  # httpx takes as long as all of the rest

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
        """The pose of a scan in a map, or why there is none: "not localized" is an answer, not an error.

        Args:
            scan: a Scan, (n, 3) points in metres in the sensor frame, the path of a scan file, or several
                scans with the way between them: the answer is then the pose of the last.
            map_id: one map, several separated by commas, or empty: all that are served. Where there are
                several, their places compete.
            prior: where the robot is known to be.
            gravity: (3,) its direction in the sensor frame (pointing down).
            options: everything that may be asked; ``prior`` and ``gravity`` are put over them. Without a
                ``deadline_ms`` the service is told how long this client waits.
            encoding: ``range_image`` sends the whole scan in a ninth to a third of the bytes, 120k points
                in under 90 KB; ``compact`` sends under 10 KB and is answered as well as the whole scan;
                ``descriptor`` sends under 1.5 KB and is answered with candidates, never ``localized``.
            parameters: of the map, for the last two. A descriptor needs those of its one map: where
                they are not given, the service is asked for them once, and again when the map changes.

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
        """As ``localize``, of a query that is encoded already: the service gets these very bytes.

        Args:
            media_type, content_encoding: what the bytes are, as clients/PROTOCOL.md says.
            request_id: to find the query by in the service's log.
        """
        return self._http.run(
            self._http.steps.ask(
                body, media_type, map_id, options or LocalizeOptions(), content_encoding, request_id
            )
        )
