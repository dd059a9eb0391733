"""The command line: the table of commands, and exit codes for errors."""

from __future__ import annotations

import sys

import typer

from firstfix.doors import COMMANDS, absent, through
from firstfix.errors import (
    DeadlineExceeded,
    FirstfixError,
    InvalidOption,
    Overloaded,
    RateLimited,
    StoreUnavailable,
    WorkerLost,
)
from firstfix.telemetry.redact import redact

from .arguments import examples
from .commands import build, check, copy_store, keys, localize, maps, recorded, sensor, serve, worker, world
from .help_pages import help_line
from .missing_package import missing_package

NO_ANSWER_EXIT_CODE = 1
ERROR_EXIT_CODE = 2
# No service, no free one, or none in time: the same command may succeed later.
NO_ANSWER = (ConnectionError, DeadlineExceeded, Overloaded, RateLimited, StoreUnavailable, WorkerLost)

EXIT_CODES = """\b
Exit codes:
  0  done; localize: localized
  1  no answer; the same command may succeed later
  2  wrong usage, wrong input, or another error
  3  localize: ambiguous
  4  localize: rejected
  5  copy-store: a map has another history in the target; all else is copied
"""
FIRST_STEPS = examples(
    "firstfix world office -o world",
    "firstfix build world/map.ply --map-id office --store store --sensor world/sensor.yaml",
    "firstfix serve --store store",
    "firstfix evaluate world/poses.csv --map office",
)

app = typer.Typer(
    name="firstfix",
    help="Localize LiDAR robots: send one scan, get the robot's pose in the map.",
    epilog=f"{FIRST_STEPS}\n\n{EXIT_CODES}",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.command(epilog=world.EXAMPLES)(world.world)
app.command(epilog=build.EXAMPLES)(build.build)
app.command(epilog=check.EXAMPLES)(check.check)
app.command(epilog=serve.EXAMPLES)(serve.serve)
app.command(epilog=worker.EXAMPLES)(worker.worker)
app.command(epilog=localize.EXAMPLES)(localize.localize)
app.command(epilog=sensor.EXAMPLES)(sensor.sensor)
app.command("copy-store", epilog=copy_store.EXAMPLES)(copy_store.copy_store)
app.add_typer(maps.app, name="maps")
app.add_typer(recorded.app, name="recorded")
app.add_typer(keys.app, name="keys")
for add_commands in through(COMMANDS).values():
    add_commands(app)


def _refuse(command: str, why: str) -> None:
    """Let a command that is not here say where it is."""

    def refuse(_: typer.Context) -> None:
        raise InvalidOption(why)

    anything = {"ignore_unknown_options": True, "allow_extra_args": True, "help_option_names": []}
    app.command(command, hidden=True, context_settings=anything)(refuse)


for _package in absent():
    for _command in _package.commands:
        _refuse(_command, _package.remedy(f"firstfix {_command}"))
_refuse("samples", "firstfix samples is now: firstfix recorded")  # until 0.2


def run(arguments: list[str] | None = None) -> None:
    """Run the command line. Errors are printed as one line on standard error, without a traceback.

    Raises:
        SystemExit: always, with the exit code.
    """
    try:
        app(arguments)
    # ConnectionError: no service. ImportError: an extra is not installed, or the compiled core is not built.
    except (FirstfixError, ConnectionError, ImportError) as error:
        text = missing_package(error) if isinstance(error, ModuleNotFoundError) else str(error)
        print(f"firstfix: {redact(text)}", file=sys.stderr)
        more = help_line(error, next(iter(sys.argv[1:] if arguments is None else arguments), ""))
        if more is not None:
            print(f"  {more}", file=sys.stderr)
        raise SystemExit(NO_ANSWER_EXIT_CODE if isinstance(error, NO_ANSWER) else ERROR_EXIT_CODE) from None


if __name__ == "__main__":
    run()
