"""The entry point ``firstfix``: one table of commands, one place where errors become a line and a code.

Exit codes: 0 done (``localize``: localized), 1 no answer, which may be better later, 2 bad usage, bad input
or an error that stays, 3 ambiguous, 4 rejected.
"""

from __future__ import annotations

import sys

import typer

from firstfix.errors import (
    DeadlineExceeded,
    FirstfixError,
    Overloaded,
    RateLimited,
    StoreUnavailable,
    WorkerLost,
)
from firstfix.redact import redact

from .commands import (
    build,
    copy_store,
    evaluate,
    keys,
    localize,
    maps,
    ros_gateway,
    samples,
    serve,
    worker,
    world,
)

NO_ANSWER_EXIT_CODE = 1
ERROR_EXIT_CODE = 2
# Nobody there, nobody free, nobody in time: the same command may succeed later.
NO_ANSWER = (ConnectionError, DeadlineExceeded, Overloaded, RateLimited, StoreUnavailable, WorkerLost)

app = typer.Typer(
    name="firstfix",
    help="The first fix for LiDAR robots: one scan in, the pose in the map out, over the network.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.command()(world.world)
app.command()(build.build)
app.command()(serve.serve)
app.command()(worker.worker)
app.command()(localize.localize)
app.command()(evaluate.evaluate)
app.command("ros-gateway")(ros_gateway.ros_gateway)
app.command("copy-store")(copy_store.copy_store)
app.add_typer(maps.app, name="maps")
app.add_typer(samples.app, name="samples")
app.add_typer(keys.app, name="keys")


def run(arguments: list[str] | None = None) -> None:
    """Runs the command line. What went wrong is one line on standard error, never a traceback.

    Raises:
        SystemExit: always, with the exit code.
    """
    try:
        app(arguments)
    # ConnectionError: no service; ModuleNotFoundError: an extra that is not installed
    except (FirstfixError, ConnectionError, ModuleNotFoundError) as error:
        print(f"firstfix: {redact(str(error))}", file=sys.stderr)
        raise SystemExit(NO_ANSWER_EXIT_CODE if isinstance(error, NO_ANSWER) else ERROR_EXIT_CODE) from None


if __name__ == "__main__":
    run()
