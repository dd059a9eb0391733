"""HTTP clients in tests share one TLS context: each would read the authorities, for 30 ms of a processor."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest


@pytest.fixture(scope="session", autouse=True)
def one_tls_context() -> Iterator[None]:
    """Applies to clients that say nothing about TLS. httpx gives all of these the same settings."""
    import httpx
    from httpx._transports import default

    make, common = httpx.create_ssl_context, httpx.create_ssl_context()

    def context(verify: Any = True, cert: Any = None, trust_env: bool = True) -> Any:
        says_nothing = verify is True and cert is None and trust_env
        return common if says_nothing else make(verify=verify, cert=cert, trust_env=trust_env)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(httpx, "create_ssl_context", context)
        patch.setattr(default, "create_ssl_context", context)
        yield
