"""Driver for asyncio: performs steps over HTTP."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncGenerator, AsyncIterator, Mapping
from contextlib import AsyncExitStack, ExitStack
from dataclasses import replace
from typing import Any, TypeVar

import httpx

from ..steps.http import HttpSteps
from ..steps.http_sender import outcome_of_error, outcome_of_response
from ..steps.step import Emit, NextLine, Outcome, Sleep, Steps, Try, Work, advance, too_late

T = TypeVar("T")


class AsyncService:
    """A service over HTTP, as ``BlockingService``. A cancelled call closes its connection.

    Args:
        transport: replaces the network in tests.
    """

    def __init__(
        self, steps: HttpSteps, headers: Mapping[str, str], transport: httpx.AsyncBaseTransport | None
    ) -> None:
        self.steps = steps
        self._http = httpx.AsyncClient(headers=headers, transport=transport, follow_redirects=False)

    async def close(self) -> None:
        """Close the connections."""
        await self._http.aclose()

    async def run(self, steps: Steps[T]) -> T:
        """Perform a call and return its result."""
        result: list[T] = []
        async for _ in self._perform(steps, result):
            pass
        return result[0]

    async def items(self, steps: Steps[None]) -> AsyncGenerator[Any, None]:
        """Perform a call and yield its items."""
        async for item in self._perform(steps, []):
            yield item

    async def _perform(self, steps: Steps[T], result: list[T]) -> AsyncGenerator[Any, None]:
        reply: Any = None
        error: Exception | None = None
        lines: AsyncIterator[str] | None = None
        async with AsyncExitStack() as opened:
            while True:
                try:
                    step = advance(steps, reply, error)
                except StopIteration as end:
                    result.append(end.value)
                    return
                reply = error = None
                if isinstance(step, Emit):
                    yield step.item
                elif isinstance(step, Try):
                    await opened.aclose()
                    reply, lines = await self._ask(step, opened)
                elif isinstance(step, NextLine):
                    reply = await _next_line(lines)
                elif isinstance(step, Sleep):
                    await asyncio.sleep(step.seconds)
                else:
                    assert isinstance(step, Work)
                    try:
                        reply = await asyncio.to_thread(step.function)
                    except Exception as raised:
                        error = raised

    async def _ask(self, step: Try, opened: AsyncExitStack) -> tuple[Outcome, AsyncIterator[str] | None]:
        if step.rival is None:
            return await self._ask_one(step, step.target, opened)
        begun = time.monotonic()
        outcome = await self._race(step, *step.rival, begun + step.timeout_s)
        return replace(outcome, took_s=time.monotonic() - begun), None

    async def _race(self, step: Try, rival: str, after_s: float, until: float) -> Outcome:
        """Ask the rival too after a while, see ``race.race``."""

        async def attempt(target: str) -> Outcome:
            left_s = max(until - time.monotonic(), 0.001)
            async with AsyncExitStack() as opened:
                return (await self._ask_one(replace(step, timeout_s=left_s), target, opened))[0]

        running = [asyncio.create_task(attempt(step.target))]
        try:
            done, _ = await asyncio.wait(running, timeout=after_s)
            raced = not done
            if raced:
                running.append(asyncio.create_task(attempt(rival)))
                done, waiting = await asyncio.wait(running, return_when=asyncio.FIRST_COMPLETED)
                if waiting and not done.copy().pop().result().is_final:
                    done, _ = await asyncio.wait(waiting)
            return replace(done.pop().result(), raced=raced)
        finally:
            for task in running:
                task.cancel()
            await asyncio.gather(*running, return_exceptions=True)

    async def _ask_one(
        self, step: Try, target: str, opened: AsyncExitStack
    ) -> tuple[Outcome, AsyncIterator[str] | None]:
        begun = time.monotonic()
        try:
            with ExitStack() as files:
                request = step.make(step.timeout_s).build(self._http, target, step.timeout_s, files)
                # httpx applies its timeout to each read, and to connecting
                sending = self._http.send(request, stream=step.stream)
                response = await asyncio.wait_for(sending, step.timeout_s)
                streams = step.stream and response.is_success
                if streams:
                    opened.push_async_callback(response.aclose)
                body = b"" if streams else await response.aread()
                if not streams:
                    await response.aclose()
        except asyncio.TimeoutError:
            return too_late(target, step.timeout_s, repeatable=step.repeatable), None
        except httpx.RequestError as error:
            return outcome_of_error(target, error, step.timeout_s, step.repeatable), None
        outcome = outcome_of_response(
            target,
            response,
            body,
            repeatable=step.repeatable,
            took_s=time.monotonic() - begun,
        )
        return outcome, response.aiter_lines() if streams else None


async def _next_line(lines: AsyncIterator[str] | None) -> str | None:
    assert lines is not None
    try:
        return await anext(lines, None)
    except httpx.TransportError:  # it broke: the reader connects again
        return None
