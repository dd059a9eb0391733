"""``AsyncClient`` for tests that block, so that one test body runs over every client."""

from __future__ import annotations

import asyncio
import inspect
from collections.abc import AsyncIterator, Iterator
from typing import Any

from firstfix_client import AsyncClient


class BlockedAsyncClient:
    """Has the methods of AsyncClient, and its arguments; what they return is awaited here."""

    def __init__(self, *arguments: Any, **named: Any) -> None:
        self._runner = asyncio.Runner()
        self._client = AsyncClient(*arguments, **named)

    def __enter__(self) -> BlockedAsyncClient:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        self._runner.run(self._client.close())
        self._runner.close()

    def __getattr__(self, name: str) -> Any:
        method = getattr(self._client, name)

        def call(*arguments: Any, **named: Any) -> Any:
            result = method(*arguments, **named)
            return self._runner.run(result) if inspect.iscoroutine(result) else self._items(result)

        return call

    def _items(self, items: AsyncIterator[Any]) -> Iterator[Any]:
        async def following() -> Any:
            return await anext(items, StopIteration)

        while (item := self._runner.run(following())) is not StopIteration:
            yield item
