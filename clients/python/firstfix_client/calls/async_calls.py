"""What the groups of asynchronous calls stand on."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..drivers.async_http import AsyncHttp
    from ..steps.http import HttpSteps


class AsyncCalls:
    """Attributes for the groups: the steps of every call, and who performs them."""

    _steps: HttpSteps
    _http: AsyncHttp
