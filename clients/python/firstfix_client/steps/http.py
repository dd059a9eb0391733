"""The HTTP calls of one client, as steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

from ..policies import HedgePolicy, RetryPolicy
from .builds import BuildSteps
from .credential import credential
from .http_messages import service_urls
from .http_sender import HttpSender
from .localize import LocalizeSteps, ask_over_http
from .maps import MapSteps
from .scan_body import BodyForm


class HttpSteps:
    """All calls over HTTP as steps, and ``sender`` for others.

    Args:
        url, timeout_s, retry, hedge, form: as in ``Client``.

    Raises:
        InvalidOption: the URL is not that of a service.
    """

    def __init__(
        self,
        url: str | Sequence[str],
        timeout_s: float,
        retry: RetryPolicy | None,
        hedge: HedgePolicy | bool | None,
        form: BodyForm,
    ) -> None:
        sender = HttpSender(service_urls(url), retry, hedge, timeout_s)
        self.sender = sender
        self.maps = MapSteps(sender)
        self.builds = BuildSteps(sender)
        self.ask = partial(ask_over_http, sender)
        self.fixes = LocalizeSteps(form, self.ask, self.maps.descriptor_parameters)


def sent_headers(api_key: str | None, headers: Mapping[str, str] | None) -> dict[str, str]:
    """Returns the headers of every request.

    Raises:
        InvalidOption: the key is not valid in a header.
    """
    key = credential(api_key)
    return {**({} if key is None else {"Authorization": f"Bearer {key}"}), **(headers or {})}
