"""A build process that is kept ready for the next build."""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path

import pytest

from firstfix_service.builds import ready_process
from firstfix_service.builds.process import BuildProcess, build_options
from firstfix_service.builds.ready_process import ReadyProcess
from firstfix_service.settings import Settings
from tests.service.service_world import FAKE_WORKER

# Says that it waits, then what it was told, and stays until its standard input ends.
WAITS = """
import sys
print('waits', flush=True)
print('told', sys.stdin.readline(), flush=True)
sys.stdin.read()
"""


@pytest.fixture
def settings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Settings:
    command = (sys.executable, "-c", WAITS)
    monkeypatch.setattr(Settings.model_fields["build_command"], "default", command)
    return Settings(store=str(tmp_path / "store"), work_dir=tmp_path, build_command=command, build_ready=True)


def ready_in(settings: Settings, **changes: object) -> ReadyProcess:
    changed = settings.model_copy(update=changes)
    options = build_options(changed)
    return ReadyProcess(changed, type(options)(**{**vars(options), "work": changed.work_dir}))


async def written(log: Path, text: str) -> None:
    while not log.exists() or text not in log.read_text():
        await asyncio.sleep(0.01)


def test_it_is_told_the_build_and_its_log_becomes_that_of_the_build(settings: Settings, tmp_path: Path):
    async def main() -> None:
        ready = ready_in(settings)
        await ready.prepare()
        await written(tmp_path / "ready.log", "waits")
        process = await ready.take("b1")
        assert process is not None
        await written(tmp_path / "b1.log", "told b1")
        assert not (tmp_path / "ready.log").exists()
        assert await ready.take("b2") is None  # a build has a process of its own
        await process.stop()

    asyncio.run(main())


def test_one_that_waits_is_kept_and_one_that_ended_is_replaced(
    settings: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(ready_process, "ENDS_AT_ONCE_S", 0.0)

    async def main() -> None:
        ready = ready_in(settings)
        await ready.prepare()
        first = ready._process
        assert isinstance(first, BuildProcess)
        await ready.prepare()
        assert ready._process is first
        first.kill()
        assert await first.wait(60.0) is not None
        await ready.prepare()
        assert ready._process is not first
        await ready.close()
        assert not (tmp_path / "ready.log").exists()

    asyncio.run(main())


def test_one_that_ends_at_once_is_not_started_again_before_the_next_build(settings: Settings):
    async def main() -> None:
        ready = ready_in(settings)
        await ready.prepare()
        first = ready._process
        assert first is not None
        first.kill()
        assert await first.wait(60.0) is not None
        for _ in range(2):
            await ready.prepare()
            assert ready._process is first
        assert await ready.take("b1") is None
        await ready.prepare()
        assert ready._process is not None
        assert ready._process is not first
        await ready.close()

    asyncio.run(main())


def test_another_attempt_of_a_build_gets_a_new_process_that_goes_on_with_its_log(
    settings: Settings, tmp_path: Path
):
    async def main() -> None:
        ready = ready_in(settings)
        await ready.prepare()
        (tmp_path / "b1.log").write_text("the first attempt\n")
        waiting = ready._process
        assert waiting is not None
        assert await ready.take("b1") is None
        assert not waiting.is_running
        assert (tmp_path / "b1.log").read_text() == "the first attempt\n"

    asyncio.run(main())


@pytest.mark.parametrize("changes", [{"build_ready": False}, {"build_command": FAKE_WORKER}])
def test_there_is_none_with_a_command_of_ones_own_or_where_none_is_wanted(
    settings: Settings, changes: dict[str, object]
):
    async def main() -> None:
        ready = ready_in(settings, **changes)
        await ready.prepare()
        assert await ready.take("b1") is None

    asyncio.run(main())
