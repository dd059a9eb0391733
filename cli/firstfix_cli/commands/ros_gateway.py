"""``firstfix ros-gateway``: first fixes for robots on rmw_zenoh."""

from __future__ import annotations

import signal
import threading
from typing import Annotated

import typer

from ..arguments import MapId, TimeoutS, Url, Zenoh, examples

EXAMPLES = examples(
    "firstfix ros-gateway --map hall",
    "firstfix ros-gateway --map hall --connect tcp/router:7447 --domain 7 --points os/points",
    "firstfix ros-gateway --map hall --imu os/imu --base-frame base_link",
)


def ros_gateway(
    map_id: MapId,
    connect: Annotated[
        str, typer.Option(metavar="ENDPOINT", help="Endpoint of the robots' zenoh router (rmw_zenohd).")
    ] = "tcp/localhost:7447",
    url: Url = None,
    zenoh: Zenoh = None,
    domain: Annotated[int, typer.Option(envvar="ROS_DOMAIN_ID", help="ROS domain.", min=0)] = 0,
    points: Annotated[
        str, typer.Option(help="Topic of the clouds, relative to a robot's namespace.")
    ] = "points",
    pose: Annotated[
        str, typer.Option(help="Topic of the pose, relative to a robot's namespace.")
    ] = "initialpose",
    imu: Annotated[
        str | None,
        typer.Option(help="Topic of an Imu that gives gravity, relative to a robot's namespace."),
    ] = None,
    tf_static: Annotated[
        str,
        typer.Option(
            help="Topic of the fixed frames, relative to a robot's namespace; with a leading slash: of all."
        ),
    ] = "tf_static",
    map_frame: Annotated[str, typer.Option(help="Frame of the published pose.")] = "map",
    base_sensor: Annotated[
        str | None,
        typer.Option(
            "--T-base-sensor",
            metavar="X,Y,Z,QX,QY,QZ,QW",
            help="Pose of the sensor on every robot.",
        ),
    ] = None,
    base_frame: Annotated[
        str, typer.Option(help="Robot's base frame, which the fixed frames link to the sensor's.")
    ] = "",
    at_start: Annotated[bool, typer.Option(help="Search for a fix when a robot appears.")] = True,
    retry_s: Annotated[float, typer.Option("--retry", help="Seconds between two tries.", min=0)] = 1.0,
    timeout_s: TimeoutS = 10.0,
) -> None:
    """Give every robot on rmw_zenoh its first fix.

    Run one process beside the robots' router. A robot is a namespace with a PointCloud2 topic. It gets its
    pose as a PoseWithCovarianceStamped, and a service first_fix/locate (std_srvs/srv/Trigger) that starts a
    new search. The command runs until it is interrupted.
    """
    from firstfix.answer.options import LocalizeOptions
    from firstfix.errors import InvalidOption
    from firstfix.ros.header import check_frame
    from firstfix_client.first_fix import FirstFixConfig

    from ..answerer import answerer
    from ..ros_gateway.fleet import RosGateway, open_session
    from ..ros_gateway.robot import Topics

    if base_sensor is not None and base_frame:
        raise InvalidOption("give only one of --T-base-sensor and --base-frame")
    options = LocalizeOptions.from_strings({} if base_sensor is None else {"T_base_sensor": base_sensor})
    config = FirstFixConfig(options, check_frame(map_frame), base_frame, retry_s)
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
            topics=Topics(points, pose, imu, tf_static),
            at_start=at_start,
            tell=lambda namespace, line: typer.echo(f"{namespace or '/'}  {line}"),
        )
        typer.echo(f"looking for robots at {connect}, domain {domain}")
        gateway.run(stop)
