"""``firstfix vda5050-gateway``: first fixes for fleets that speak VDA 5050."""

from __future__ import annotations

import signal
import threading
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from firstfix_cli.arguments import Store, TimeoutS, Url, Zenoh, examples

EXAMPLES = examples(
    "firstfix vda5050-gateway --broker mqtt://broker --fleets fleets.yaml",
    "firstfix vda5050-gateway --broker mqtts://broker:8883 --ca ca.pem --user firstfix "
    "--password-file /run/secrets/mqtt --fleets fleets.yaml --url http://firstfix:8080",
)


def vda5050_gateway(
    broker: Annotated[
        str, typer.Option(metavar="URL", help="Broker: mqtt://HOST[:PORT], or mqtts:// with TLS.")
    ],
    fleets: Annotated[
        Path, typer.Option(metavar="FILE", help="YAML file of the fleets: their topics, maps and scans.")
    ],
    url: Url = None,
    zenoh: Zenoh = None,
    store: Store = None,
    user: Annotated[str | None, typer.Option(help="User at the broker.")] = None,
    password_file: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="File whose first line is the password [default: the environment variable "
            "FIRSTFIX_MQTT_PASSWORD].",
        ),
    ] = None,
    ca: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="PEM file of the authorities that may sign the broker's certificate "
            "[default: the system's].",
        ),
    ] = None,
    certificate: Annotated[
        Path | None, typer.Option(metavar="FILE", help="PEM file with the gateway's certificate and key.")
    ] = None,
    client_id: Annotated[
        str, typer.Option(help="Client id at the broker. Only one gateway may have it.")
    ] = "firstfix-vda5050-gateway",
    mqtt: Annotated[
        int, typer.Option(metavar="VERSION", help="MQTT version: 5, or 3 for 3.1.1.", min=3, max=5)
    ] = 5,
    timeout_s: TimeoutS = 10.0,
) -> None:
    """Give lost VDA 5050 vehicles their position.

    Watches state and connection of the vehicles. Where a vehicle does not know its position, stands still and
    has no order, its scan is localized, and it is sent the instant action initPosition. Only an answer that
    is localized is sent. The command runs until it is interrupted.
    """
    from firstfix.errors import InvalidOption, pip_install
    from firstfix_cli.answerer import answerer

    from ..vda5050.fix_seeker import Fleet
    from ..vda5050.fleets_file import read_fleets
    from ..vda5050.gateway import Gateway

    try:
        from ..vda5050.broker import Broker, BrokerAddress, Login, password_of
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "paho":
            raise
        raise ModuleNotFoundError(
            f"VDA 5050 needs the package paho-mqtt: {pip_install('./plugins/fleet[vda5050]')}",
            name=error.name,
        ) from None

    address, entries = BrokerAddress.parse(broker), read_fleets(fleets)
    if mqtt == 4:
        raise InvalidOption("--mqtt is 5, or 3 for 3.1.1")
    if store is not None and any(len(entry.maps) > 1 for entry in entries.values()):
        raise InvalidOption("with --store a fleet has one map; a service searches several")
    login = Login(client_id, user, password_of(password_file), ca, certificate)
    connection = Broker(address, login, version=mqtt, log_line=typer.echo)
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    with ExitStack() as stack:
        found = [
            Fleet(
                name,
                entry,
                stack.enter_context(
                    answerer(
                        ",".join(entry.maps),
                        url=url,
                        zenoh=zenoh,
                        store=store,
                        timeout_s=timeout_s,
                        follow=typer.echo,
                    )
                ),
            )
            for name, entry in entries.items()
        ]
        gateway = Gateway(
            found,
            connection.publish,
            connection.subscribe,
            connection.unsubscribe,
            lambda vehicle, line: typer.echo(f"{vehicle}  {line}" if vehicle else line),
        )
        stack.callback(gateway.close)
        connection.run(gateway, stop)
