"""``firstfix localize``: one fix."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..arguments import AsJson, MapId, SentAs, Store, TimeoutS, Url, Zenoh

if TYPE_CHECKING:
    from firstfix.localization import Localization

EXIT_CODES = {"localized": 0, "ambiguous": 3, "rejected": 4}


def localize(
    scan: Annotated[Path, typer.Argument(help="Scan file: .pcd, .ply, .bin, .npy, .xyz, .laz, .ffscan ...")],
    map_id: MapId,
    url: Url = None,
    zenoh: Zenoh = None,
    store: Store = None,
    gravity: Annotated[
        str | None, typer.Option(help="In the sensor frame: x,y,z (down), or roll_deg,pitch_deg.")
    ] = None,
    base_sensor: Annotated[
        str | None,
        typer.Option("--T-base-sensor", metavar="X,Y,Z,QX,QY,QZ,QW", help="Where the sensor is mounted."),
    ] = None,
    prior: Annotated[
        str | None, typer.Option(help="Where it is known to be: x,y,z,radius_m[,yaw_deg,yaw_range_deg].")
    ] = None,
    max_candidates: Annotated[int | None, typer.Option(help="Places to try at most.")] = None,
    min_probability: Annotated[float | None, typer.Option(help="Below it: not localized.")] = None,
    version: Annotated[
        str | None, typer.Option(help="Map version, 64 characters [default: the active one].")
    ] = None,
    encoding: SentAs = "scan",
    timeout_s: TimeoutS = 30.0,
    as_json: AsJson = False,
) -> None:
    """Find the pose of a scan in a map. Exit code 0: localized, 3: ambiguous, 4: rejected."""
    from firstfix.decode import read_scan_file
    from firstfix.options import LocalizeOptions

    from ..answerer import answerer

    given = {
        "gravity": gravity,
        "prior": prior,
        "T_base_sensor": base_sensor,
        "max_candidates": max_candidates,
        "min_probability": min_probability,
        "version": version,
    }
    options = LocalizeOptions.from_strings({k: str(v) for k, v in given.items() if v is not None})
    query = read_scan_file(scan)
    with answerer(map_id, url=url, zenoh=zenoh, store=store, timeout_s=timeout_s, encoding=encoding) as ask:
        answer = ask(query, options)
    if as_json:
        typer.echo(json.dumps(answer.to_mapping()))
    else:
        typer.echo("\n".join(lines_of(answer)))
    raise typer.Exit(EXIT_CODES[answer.verdict.value])


def lines_of(answer: Localization) -> list[str]:
    """The answer for people."""
    import numpy as np

    from firstfix.transform import Matrix, yaw_of

    def place(T: Matrix) -> str:
        x, y, z = T[:3, 3]
        return f"x {x:.3f}  y {y:.3f}  z {z:.3f} m  yaw {np.degrees(yaw_of(T)):.2f} deg"

    why = f" ({', '.join(reason.value for reason in answer.reasons)})" if answer.reasons else ""
    lines = [f"{answer.verdict.value}{why}, probability {answer.probability:.3f}"]
    if answer.T_map_sensor is not None:
        lines.append(f"  sensor  {place(answer.T_map_sensor)}")
    if answer.T_map_base is not None:
        lines.append(f"  base    {place(answer.T_map_base)}")
    if answer.covariance is not None:
        sigma = np.sqrt(np.diag(answer.covariance))
        lines.append(f"  sigma   {sigma[:3].max() * 1000:.1f} mm, {np.degrees(sigma[3:]).max():.3f} deg")
    if answer.T_map_sensor is None:
        for h in answer.hypotheses[:3]:
            lines.append(f"  maybe   {place(h.T_map_sensor)}  probability {h.probability:.2f}")
    lines.append(f"  map     {answer.map_id or '?'}, version {answer.map_version[:12] or '?'}")
    if answer.timings_ms:
        stages = ", ".join(f"{stage} {ms:.1f}" for stage, ms in answer.timings_ms.items())
        lines.append(f"  ms      {stages}")
    return lines
