"""The HTTP calls of one client as steps, and the credential that it sends."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from functools import partial

from firstfix.errors import InvalidOption

from ..policies import HedgePolicy, RetryPolicy
from .builds import BuildSteps
from .http_sender import HttpSender, service_urls
from .localize import LocalizeSteps, ask_over_http
from .maps import MapSteps
from .scan_body import BodyForm

VARIABLE = "FIRSTFIX_API_KEY"


def credential(given: str | None) -> str | None:
    """The given API key or token, else that of the environment, else None.

    Raises:
        InvalidOption: the key is not valid in a header. The message does not contain it.
    """
    found = os.environ.get(VARIABLE) if given is None else given
    if not found:
        return None
    key = found.strip()  # a key read from a file ends with a newline
    if not key.isascii() or not key.isprintable() or " " in key:
        raise InvalidOption("an API key can only have printable ASCII characters, without spaces")
    return key


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
    """The headers of every request.

    Raises:
        InvalidOption: the key is not valid in a header.
    """
    key = credential(api_key)
    return {**({} if key is None else {"Authorization": f"Bearer {key}"}), **(headers or {})}
