from __future__ import annotations

import pytest

from firstfix.errors import InvalidOption
from firstfix_builder.execution.executor_url import dask_address


@pytest.mark.parametrize(
    ("executor", "address"),
    [
        ("threads", None),
        ("dask://scheduler:8786", "tcp://scheduler:8786"),
        ("dask://10.0.0.7:8786/", "tcp://10.0.0.7:8786"),
        ("dask://[fd00::7]:8786", "tcp://[fd00::7]:8786"),
        ("dask+tls://scheduler.maps.svc:8786", "tls://scheduler.maps.svc:8786"),
    ],
)
def test_an_executor_is_threads_or_a_scheduler(executor: str, address: str | None):
    assert dask_address(executor) == address


@pytest.mark.parametrize(
    ("executor", "said"),
    [
        ("", "no executor"),
        ("thread", "no executor 'thread'"),
        ("tcp://scheduler:8786", "dask://HOST:PORT"),
        ("dask://", "names no scheduler"),
        ("dask://scheduler", "names no scheduler"),
        ("dask://:8786", "names no scheduler"),
        ("dask://scheduler:0", "names no scheduler"),
        ("dask://scheduler:99999", "names no scheduler"),
        ("dask://scheduler:port", "names no scheduler"),
        ("dask://me@scheduler:8786", "without user, path or query"),
        ("dask://scheduler:8786/maps", "without user, path or query"),
        ("dask://scheduler:8786?workers=4", "without user, path or query"),
    ],
)
def test_anything_else_is_refused_with_a_reason(executor: str, said: str):
    with pytest.raises(InvalidOption) as caught:
        dask_address(executor)
    assert said in str(caught.value)
