"""``firstfix ros-gateway``: first fixes for robots with ROS 2, by rclpy, on DDS or on rmw_zenoh."""

from __future__ import annotations

import signal
import threading
from pathlib import Path
from typing import Annotated

import typer

from firstfix_cli.arguments import MapId, Store, TimeoutS, Url, Zenoh, examples

EXAMPLES = examples(
    "firstfix ros-gateway --map hall --points os/points --base-frame base_link",
    "firstfix ros-gateway --map hall --imu os/imu --base-frame base_link --no-at-start --watch 1",
    "firstfix ros-gateway --dds --map hall --store s3://maps",
    "firstfix ros-gateway --map hall --connect tcp/router:7447 --domain 7 --points os/points",
)


def ros_gateway(
    map_id: MapId,
    dds: Annotated[
        bool,
        typer.Option(
            "--dds",
            help="Join the robots' DDS domain without ROS 2. The start says what cannot be done so.",
            show_default=False,
        ),
    ] = False,
    connect: Annotated[
        str | None,
        typer.Option(
            metavar="ENDPOINT",
            help="Ask the robots' zenoh router (rmw_zenohd) without ROS 2: tcp/localhost:7447.",
        ),
    ] = None,
    url: Url = None,
    zenoh: Zenoh = None,
    store: Store = None,
    domain: Annotated[int, typer.Option(envvar="ROS_DOMAIN_ID", help="ROS domain.", min=0, max=232)] = 0,
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
    tf: Annotated[
        str,
        typer.Option(
            help="Topic of the moving frames, relative to a robot's namespace; with a leading slash: of all."
        ),
    ] = "tf",
    tf_static: Annotated[
        str,
        typer.Option(
            help="Topic of the fixed frames, relative to a robot's namespace; with a leading slash: of all."
        ),
    ] = "tf_static",
    own_pose: Annotated[
        str | None,
        typer.Option(
            help="Topic of the poses (PoseWithCovarianceStamped) of the robot's own localization, for "
            "--watch. By default they are taken from the moving frames."
        ),
    ] = None,
    map_frame: Annotated[str, typer.Option(help="Frame of the published pose.")] = "map",
    odom_frame: Annotated[str, typer.Option(help="Frame of the robot's odometry.")] = "odom",
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
    watch_s: Annotated[
        float,
        typer.Option(
            "--watch",
            metavar="SECONDS",
            help="Check the robot's own localization so often, and say when it has gone astray. 0: never.",
            min=0,
        ),
    ] = 0.0,
    publish_tf: Annotated[
        bool,
        typer.Option(
            help="Publish the transform from the map to the odometry after a fix, unless somebody else does."
        ),
    ] = True,
    repeat_s: Annotated[
        float,
        typer.Option(
            "--repeat",
            metavar="SECONDS",
            help="Publish the pose again until the robot's localizer follows, at most so often. 0: once.",
            min=0,
        ),
    ] = 5.0,
    young_s: Annotated[
        float,
        typer.Option(
            "--young",
            metavar="SECONDS",
            help="So long the pose is repeated without odometry, or to a localizer that is not heard.",
            min=0,
        ),
    ] = 10.0,
    memory: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Folder that keeps each robot's last fix, so that a restart gives none a second first fix "
            "[default: one for each domain in the user's folder for states].",
            show_default=False,
        ),
    ] = None,
    timeout_s: TimeoutS = 10.0,
) -> None:
    """Give every robot with ROS 2 its first fix.

    Run one process in the robots' network. It uses the ROS 2 that is sourced, with any middleware;
    --dds and --connect need none. A robot is a namespace with a PointCloud2 topic. It gets its pose as a
    PoseWithCovarianceStamped, and a service first_fix/relocalize (std_srvs/srv/Trigger) that starts a new
    search. The command runs until it is interrupted.
    """
    from firstfix.answer.options import LocalizeOptions
    from firstfix.errors import InvalidOption
    from firstfix_cli.answerer import answerer
    from firstfix_ros.robot.config import GatewayConfig
    from firstfix_ros.robot.fix_memory import user_memory
    from firstfix_ros.robot.topics import Topics

    from ..open_fleet import open_fleet

    if base_sensor is not None and base_frame:
        raise InvalidOption("give only one of --T-base-sensor and --base-frame")
    if own_pose is not None and not base_frame:
        raise InvalidOption("--own-pose needs --base-frame: whose pose it is")
    options = LocalizeOptions.from_strings({} if base_sensor is None else {"T_base_sensor": base_sensor})
    config = GatewayConfig(
        options,
        map_frame,
        odom_frame,
        base_frame,
        at_start,
        retry_s,
        watch_s,
        publishes_tf=publish_tf,
        repeat_s=repeat_s,
        young_s=young_s,
        memory=memory or user_memory(domain),
    )
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    with (
        answerer(map_id, url=url, zenoh=zenoh, store=store, timeout_s=timeout_s, follow=typer.echo) as ask,
        open_fleet(
            ask,
            config,
            Topics(points, pose, imu, tf, tf_static, own_pose),
            dds=dds,
            connect=connect,
            domain=domain,
            log_line=lambda namespace, line: typer.echo(f"{namespace or '/'}  {line}"),
        ) as opened,
    ):
        typer.echo(f"looking for robots {opened.place}, domain {domain}")
        if opened.cannot:
            typer.echo(f"note: {opened.cannot}")
        opened.fleet.run(stop)
