"""``make demo``: makes a sample world, builds its map in a local service, and localizes its scans.

Everything is real and has its default: file store, build in the service, HTTP and zenoh. Where racks of the
world look alike, the right answer is ``ambiguous``; the demo then shows its first hypothesis. The demo fails
if a first hypothesis is off by more than 0.1 m, if too few scans are localized, or if a scan from another
place gets a pose. With ``OPEN=1`` in the environment the service goes on until Ctrl-C, with the console at
its address.
"""

from __future__ import annotations

import math
import os
import sys
import time
from contextlib import suppress
from pathlib import Path

import httpx
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from firstfix.answer.options import LocalizeOptions
from firstfix.bit_exact.sample import rows_by_chance
from firstfix.scan_file import read_scan_file
from firstfix.sensor import SensorModel
from firstfix.transform import Matrix, pose_error, yaw_of
from firstfix_cli.answerer import fetch_active_version
from firstfix_cli.local_service import LocalService, local_service
from firstfix_cli.poses_csv import PosedScan, read_poses_csv
from firstfix_cli.sample_world import write_world
from firstfix_client import BuildStatus, Client, ZenohClient

from .evaluation.outcome import Outcome, outcome_of, report_of
from .evaluation.plot import MapPicture, draw
from .worlds import make_world

WORLD = "factory"
DIRECTORY = Path("demo")
PORT = 8080  # of HTTP, if it is free
WORST_M = 0.1
FOREIGN_SHOWN, OWN_SHOWN = 2, 10
MIN_LOCALIZED = 7  # of the ten


def main() -> int:
    """Run the demo and return its exit code."""
    console = Console(width=110)
    world, store = DIRECTORY / WORLD, DIRECTORY / "store"
    console.rule(f"firstfix: a first fix in the sample world [bold]{WORLD}[/bold]")
    if not (world / "poses.csv").exists():
        console.print(f"Making the world in {world} ...")
        write_world(make_world(WORLD), world)
    with local_service(DIRECTORY, store, PORT) as service:
        console.print(f"Service at {service.url} and {service.zenoh}, log in {service.log}")
        version = _build(console, service, world)
        console.print(f"Map [bold]{WORLD}[/bold] published as version {version[:12]}")
        scans = _chosen(read_poses_csv(world / "poses.csv"))
        http = _localize(Client(service.url, timeout_s=30.0), scans, version)
        zenoh = _localize(ZenohClient(service.zenoh, timeout_s=30.0), scans, version)
        code = _show(console, store, version, scans, http, zenoh)
        offer_console(console, service)
    return code


def _show(
    console: Console,
    store: Path,
    version: str,
    scans: list[PosedScan],
    http: list[Outcome],
    zenoh: list[Outcome],
) -> int:
    """Print the poses and draw the picture. Returns the exit code."""
    console.print(_table(scans, http, zenoh))
    picture = DIRECTORY / "demo.png"
    loaded = {str(row.path): read_scan_file(row.path) for row in scans}
    directory = fetch_active_version(str(store), WORLD, version)[1]
    draw(picture, WORLD, MapPicture.load(directory), http, loaded, report_of(http))
    console.print(f"Picture: [bold]{picture}[/bold]")
    wrong = [o for o in [*http, *zenoh] if not _is_right(o)]
    for outcome in wrong:
        said = f"{outcome.answer.verdict.value}, {_best_error_m(outcome):.3f} m"
        console.print(f"[red]wrong:[/red] {outcome.name}: {said}")
    localized = sum(o.is_accepted for o in http)
    if localized < MIN_LOCALIZED:
        console.print(f"[red]wrong:[/red] {localized} scans localized")
        return 1
    if not wrong:
        console.print(
            f"[green]{localized} of {len(http) - FOREIGN_SHOWN} localized, the best place of the others"
            f" marked ?; every one within {WORST_M} m of the truth, none for scans of other places.[/green]"
        )
    return 1 if wrong else 0


def offer_console(console: Console, service: LocalService) -> None:
    """Print where the console is, and with OPEN=1 keeps the service running until Ctrl-C."""
    address = f"{service.url}/console/"
    if not httpx.get(address).is_success:
        console.print("Console: this installation has none. [bold]make console[/bold] builds it.")
        return
    if os.environ.get("OPEN", "") in ("", "0"):
        console.print(
            f"Console: [bold]make demo OPEN=1[/bold] keeps the service running, with it at {address}"
        )
        return
    console.print(f"Console: [bold]{address}[/bold]\nThe service runs until you press Ctrl-C.")
    with suppress(KeyboardInterrupt):
        service.process.wait()


def _build(console: Console, service: LocalService, world: Path) -> str:
    """Build the map in the service and return its version."""
    import yaml

    sensor = SensorModel.from_mapping(yaml.safe_load((world / "sensor.yaml").read_text()))
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with (
        Client(service.url, timeout_s=30) as client,
        Progress(*columns, console=console, transient=True) as bars,
    ):
        started = client.build_map(
            world / "map.ply",
            WORLD,
            config={"sensor": sensor.to_mapping()},
            trajectory=world / "trajectory.txt",
        )
        bar = bars.add_task("queued", total=1.0)

        def show(status: BuildStatus) -> None:
            bars.update(bar, description=f"build: {status.stage or status.state}", completed=status.progress)

        version = client.wait_for_build(started.build_id, progress=show).version
    assert version is not None  # wait_for_build raises otherwise
    return version


def _chosen(rows: list[PosedScan]) -> list[PosedScan]:
    own = [row for row in rows if row.T_map_sensor is not None]
    foreign = [row for row in rows if row.T_map_sensor is None]
    return [own[row] for row in rows_by_chance(len(own), OWN_SHOWN)] + foreign[:FOREIGN_SHOWN]


def _localize(client: Client | ZenohClient, scans: list[PosedScan], version: str) -> list[Outcome]:
    """Ask for the scans in a version: just now a provisional one may still answer others."""
    outcomes, options = [], LocalizeOptions(version=version)
    with client:
        for row in scans:
            scan = read_scan_file(row.path)
            begin = time.perf_counter()
            answer = client.localize(scan, map_id=WORLD, options=options)
            ms = (time.perf_counter() - begin) * 1e3
            outcomes.append(outcome_of(str(row.path), row.T_map_sensor, answer, ms))
    return outcomes


def _is_right(outcome: Outcome) -> bool:
    if outcome.T_map_sensor is None:
        return not outcome.is_accepted
    return _best_error_m(outcome) <= WORST_M


def _best_error_m(outcome: Outcome) -> float:
    """The error of the first hypothesis, infinite without one."""
    places = outcome.answer.hypotheses
    if outcome.T_map_sensor is None or not places:
        return math.inf
    return pose_error(outcome.T_map_sensor, places[0].T_map_sensor)[0]


def _table(scans: list[PosedScan], http: list[Outcome], zenoh: list[Outcome]) -> Table:
    table = Table("scan", "truth: x, y, yaw", "HTTP", "error", "ms", "zenoh", "error", "ms")
    for column in table.columns:
        column.no_wrap = True
    for row, *both in zip(scans, http, zenoh, strict=True):
        cells = [row.path.name, _pose(row.T_map_sensor) if row.T_map_sensor is not None else "elsewhere"]
        for outcome in both:
            cells += [*_said(outcome), f"{outcome.ms:.0f}"]
        table.add_row(*cells)
    return table


def _said(outcome: Outcome) -> tuple[str, str]:
    """The first hypothesis, with a question mark if it is not localized, and its error."""
    if outcome.T_map_sensor is None:
        return outcome.answer.verdict.value, ""
    error_m = _best_error_m(outcome)
    if math.isinf(error_m):
        return outcome.answer.verdict.value, ""
    doubt = "" if outcome.is_accepted else "? "
    return doubt + _pose(outcome.answer.hypotheses[0].T_map_sensor), f"{error_m * 100:.1f} cm"


def _pose(T: Matrix) -> str:
    return f"{T[0, 3]:.2f} {T[1, 3]:.2f} {math.degrees(yaw_of(T)):.0f}°"


if __name__ == "__main__":
    sys.exit(main())
