"""``firstfix ros-gateway``: first fixes for robots on rmw_zenoh."""

from __future__ import annotations

import signal
import threading
from typing import Annotated

import typer

from ..arguments import MapId, TimeoutS, Url, Zenoh


def ros_gateway(
    map_id: MapId,
    connect: Annotated[
        str, typer.Option(metavar="ENDPOINT", help="zenoh router of the robots (rmw_zenohd).")
    ] = "tcp/localhost:7447",
    url: Url = None,
    zenoh: Zenoh = None,
    domain: Annotated[int, typer.Option(envvar="ROS_DOMAIN_ID", help="ROS domain.", min=0)] = 0,
    points: Annotated[str, typer.Option(help="Topic of the clouds, below a robot's namespace.")] = "points",
    pose: Annotated[str, typer.Option(help="Topic of the pose, below it.")] = "initialpose",
    map_frame: Annotated[str, typer.Option(help="Frame of the pose.")] = "map",
    base_sensor: Annotated[
        str | None,
        typer.Option(
            "--T-base-sensor",
            metavar="X,Y,Z,QX,QY,QZ,QW",
            help="How the sensor is mounted, on every robot.",
        ),
    ] = None,
    at_start: Annotated[bool, typer.Option(help="A first fix for every robot that shows.")] = True,
    retry_s: Annotated[float, typer.Option("--retry", help="Seconds from try to try.", min=0)] = 1.0,
    timeout_s: TimeoutS = 10.0,
) -> None:
    """Give every robot on rmw_zenoh its first fix: one process beside their router, until it is interrupted.

    A robot is a namespace with a PointCloud2 topic; it gets a PoseWithCovarianceStamped and a service
    first_fix/locate (std_srvs/srv/Trigger).
    """
    from firstfix.answer.options import LocalizeOptions
    from firstfix.ros.header import check_frame
    from firstfix_client.first_fix import FirstFixConfig

    from ..answerer import answerer
    from ..ros_gateway import RosGateway, open_session

    options = LocalizeOptions.from_strings({} if base_sensor is None else {"T_base_sensor": base_sensor})
    config = FirstFixConfig(options=options, map_frame=check_frame(map_frame), retry_s=retry_s)
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    with (
        answerer(map_id, url=url, zenoh=zenoh, store=None, timeout_s=timeout_s) as ask,
        open_session(connect) as session,
    ):
        gateway = RosGateway(
            session,
            ask,
            config,
            domain=domain,
            points=points,
            pose_topic=pose,
            at_start=at_start,
            tell=lambda namespace, line: typer.echo(f"{namespace or '/'}  {line}"),
        )
        typer.echo(f"looking for robots at {connect}, domain {domain}")
        gateway.run(stop)
