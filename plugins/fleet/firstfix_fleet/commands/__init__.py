"""Commands of the fleet's gateways."""

from __future__ import annotations

import typer

from . import ros_gateway, vda5050_gateway


def add_commands(app: typer.Typer) -> None:
    """Add the gateways to ``firstfix``."""
    app.command("ros-gateway", epilog=ros_gateway.EXAMPLES)(ros_gateway.ros_gateway)
    app.command("vda5050-gateway", epilog=vda5050_gateway.EXAMPLES)(vda5050_gateway.vda5050_gateway)
