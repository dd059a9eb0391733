"""Localization requests over both transports, and the reading of the answers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import Prior
from firstfix.errors import DescriptorMismatch
from firstfix.ids import check_robot_name
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence

from .http_sender import HttpRequest, HttpSender
from .scan_body import BodyForm, ScanLike, encoded, scan_of
from .step import Steps, work

if TYPE_CHECKING:
    from firstfix.scan.descriptor_parameters import DescriptorParameters


# (body, media type, map ids, options, name of the robot) to the steps of a query.
AskBody = Callable[[bytes, str, str, LocalizeOptions, "str | None"], Steps[Localization]]
ParametersOf = Callable[[str], "Steps[DescriptorParameters]"]


def options_of(
    options: LocalizeOptions | None, prior: Prior | None, gravity: ArrayLike | None
) -> LocalizeOptions:
    """The options with prior and gravity replaced, where given."""
    chosen = options or LocalizeOptions()
    if prior is not None:
        chosen = replace(chosen, prior=prior)
    if gravity is not None:
        chosen = replace(chosen, gravity=np.asarray(gravity, np.float64))
    return chosen


class LocalizeSteps:
    """Localization as steps. Remembers the parameters of maps that are asked by descriptor.

    Args:
        form: the client's encoding of scans.
        parameters_of: gets a map's parameters; None: each query must bring them.
    """

    def __init__(self, form: BodyForm, ask: AskBody, parameters_of: ParametersOf | None) -> None:
        self._form = form
        self._ask = ask
        self._parameters_of = parameters_of
        self._known: dict[str, DescriptorParameters] = {}

    def localize(
        self,
        scan: ScanLike | ScanSequence,
        map_id: str,
        options: LocalizeOptions,
        form: BodyForm,
        robot: str | None = None,
    ) -> Steps[Localization]:
        """Encode a scan and ask for its pose.

        Args:
            form: encoding and parameters of this query; the client's resolutions are used.
            robot: its name, if it has one.
        """
        form = replace(self._form, encoding=form.encoding, parameters=form.parameters)
        if form.encoding != "descriptor" or form.parameters is not None or self._parameters_of is None:
            return (yield from self._encode_and_ask(scan, map_id, options, form, robot))
        known = map_id in self._known
        form = replace(form, parameters=(yield from self._looked_up(map_id)))
        try:
            return (yield from self._encode_and_ask(scan, map_id, options, form, robot))
        except DescriptorMismatch:
            if not known:
                raise
            self._known.pop(map_id, None)  # another version has become active
        form = replace(form, parameters=(yield from self._looked_up(map_id)))
        return (yield from self._encode_and_ask(scan, map_id, options, form, robot))

    def _looked_up(self, map_id: str) -> Steps[DescriptorParameters]:
        found = self._known.get(map_id)
        if found is None:
            assert self._parameters_of is not None
            found = self._known[map_id] = yield from self._parameters_of(map_id)
        return found

    def _encode_and_ask(
        self,
        scan: ScanLike | ScanSequence,
        map_id: str,
        options: LocalizeOptions,
        form: BodyForm,
        robot: str | None,
    ) -> Steps[Localization]:
        if not isinstance(scan, ScanSequence):
            given = scan
            scan = yield from work(lambda: scan_of(given))
        media_type, body = yield from work(lambda: encoded(scan, form, options.gravity))
        if isinstance(scan, Scan) and scan.dropped.points > len(scan):  # else they are not what is wrong
            options = replace(options, dropped=scan.dropped)
        return (yield from self._ask(body, media_type, map_id, options, robot))


def ask_over_http(
    http: HttpSender,
    body: bytes,
    media_type: str,
    map_id: str,
    options: LocalizeOptions,
    robot: str | None = None,
    content_encoding: str | None = None,
    request_id: str | None = None,
) -> Steps[Localization]:
    """Send an encoded query.

    Raises:
        InvalidOption: the robot's name is malformed.
    """
    params = {"map": map_id, **options.to_strings()}
    headers = {"Content-Type": media_type}
    if content_encoding:
        headers["Content-Encoding"] = content_encoding
    if request_id:
        headers["X-Request-Id"] = request_id
    if robot is not None:
        headers["X-Robot"] = check_robot_name(robot)

    def make(left_s: float) -> HttpRequest:
        query = {"deadline_ms": str(max(1, int(left_s * 1000))), **params}
        return HttpRequest("POST", ("localize",), params=query, headers=headers, content=body)

    answer = yield from http.send(make, hedged=True)
    return answer.parsed(Localization.from_mapping)
