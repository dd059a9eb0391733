"""What the groups of asynchronous calls stand on."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .async_http import AsyncHttp
    from .http_steps import HttpSteps


class AsyncCalls:
    """Attributes for the groups: the steps of every call, and who performs them."""

    _steps: HttpSteps
    _http: AsyncHttp
