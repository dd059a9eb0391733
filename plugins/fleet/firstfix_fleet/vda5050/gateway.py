"""The gateway: all vehicles of all fleets, and what they are sent. It knows no MQTT."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone

from firstfix.errors import InputError

from .fix_seeker import FixSeeker, Fleet
from .log_lines import LogLines
from .messages import Connection, Sender, State, read_message
from .topics import VehicleFilter, VehicleName
from .vehicle import Command, DropFix, Patience, Send, TakeFix, Vehicle

MAX_VEHICLES = 10_000  # some kilobytes of memory each
FORGET_S = 600.0  # one that was silent for so long may give its place to another
TICK_S = 0.25
STATE, CONNECTION, ORDER, INSTANT_ACTIONS = "state", "connection", "order", "instantActions"


@dataclass
class _Followed:
    fleet: Fleet
    vehicle: Vehicle
    heard_s: float
    told: str = ""
    complaint: str = ""


class Gateway:
    """Follows the vehicles. All methods are for the thread of the broker's connection.

    Args:
        publish: sends a message now. Returns whether it was sent; one that was not is never sent.
        subscribe, unsubscribe: of a topic that has scans.
        log_line: takes the name of a vehicle, or none, and a line about it.
        clock: seconds that never go back.
    """

    def __init__(
        self,
        fleets: Sequence[Fleet],
        publish: Callable[[str, bytes], bool],
        subscribe: Callable[[str], None],
        unsubscribe: Callable[[str], None],
        log_line: Callable[[str, str], None],
        *,
        patience: Patience | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._filters = [(VehicleFilter.parse(fleet.entry.topics), fleet) for fleet in fleets]
        self._maps = {fleet.name: fleet.entry.fleet_maps for fleet in fleets}
        self._publish, self._subscribe, self._clock = publish, subscribe, clock
        self._log = LogLines(log_line, clock)
        self._patience = patience or Patience()
        self._seeker = FixSeeker(subscribe, unsubscribe, clock)
        self._vehicles: dict[VehicleName, _Followed] = {}
        self._is_full = False
        self._header_ids = itertools.count(1)
        self._next_tick_s = clock()

    @property
    def lines(self) -> dict[str, str]:
        """The state of each vehicle as one line of text, by the vehicle's name."""
        return {str(name): one.vehicle.line for name, one in self._vehicles.items() if one.vehicle.line}

    def connected(self) -> None:
        """Subscribe to everything: a new connection knows no topic."""
        for one, _ in self._filters:
            for name in (CONNECTION, STATE, ORDER):
                self._subscribe(one.of(name))
        for topic in self._seeker.topics():
            self._subscribe(topic)

    def disconnected(self) -> None:
        """Believes nothing that was said before: what the vehicles say meanwhile is missed."""
        now_s = self._clock()
        for name, one in self._vehicles.items():
            self._do(name, one, one.vehicle.lose_sight(now_s))

    def take(self, topic: str, body: bytes, *, retained: bool) -> None:
        """Take a message. One that cannot be used gets a line in the log, and changes nothing.

        Args:
            retained: it was sent at some time before. Only a connection is still of use then.
        """
        if not retained and self._seeker.take_scan(topic, body):
            return
        found = VehicleName.of_topic(topic)
        if found is None:
            return
        name, kind = found
        fleet = next((fleet for one, fleet in self._filters if one.matches(name)), None)
        if fleet is None or kind not in (STATE, CONNECTION, ORDER) or (retained and kind != CONNECTION):
            return
        now_s = self._clock()
        one = self._followed(name, fleet, now_s)
        if one is None:
            return
        sender = Sender(name.manufacturer, name.serial)
        try:
            if kind == CONNECTION:
                online = read_message(Connection, body, sender).is_online
                commands = one.vehicle.take_connection(online, now_s)
            elif kind == STATE:
                commands = one.vehicle.take_state(read_message(State, body, sender), now_s)
            else:
                commands = one.vehicle.take_order(now_s)
        except InputError as error:
            if str(error) != one.complaint:  # once in a row
                one.complaint = str(error)
                self._log.write(str(name), f"left alone: {error}")
            return
        self._do(name, one, commands)

    def tick(self) -> None:
        """Let time pass, and goes on with what has been found. Call it often: mostly it does nothing."""
        for outcome in self._seeker.outcomes():
            followed = self._vehicles.get(outcome.vehicle)
            if followed is None:
                self._seeker.forget(outcome.vehicle)
            else:
                now_s = self._clock()
                commands = followed.vehicle.take_outcome(outcome.attempt, outcome.result, now_s)
                self._do(outcome.vehicle, followed, commands)
        now_s = self._clock()
        if now_s < self._next_tick_s:
            return
        self._next_tick_s = now_s + TICK_S
        for name, followed in self._vehicles.items():
            self._do(name, followed, followed.vehicle.tick(now_s))

    def close(self) -> None:
        """End the queries, and tells which vehicles are still lost."""
        self._seeker.close()
        for name, one in self._vehicles.items():
            if one.vehicle.is_lost:
                self._log.write(str(name), f"left behind: {one.vehicle.line}")

    def _followed(self, name: VehicleName, fleet: Fleet, now_s: float) -> _Followed | None:
        one = self._vehicles.get(name)
        if one is None:
            if len(self._vehicles) >= MAX_VEHICLES and not self._forget(now_s):
                if not self._is_full:
                    self._is_full = True
                    self._log.write("", f"more than {MAX_VEHICLES} vehicles: others are left alone")
                return None
            one = _Followed(fleet, Vehicle(self._maps[fleet.name], self._patience), now_s)
            self._vehicles[name] = one
        one.heard_s = now_s
        return one

    def _forget(self, now_s: float) -> bool:
        silent = [name for name, one in self._vehicles.items() if now_s - one.heard_s > FORGET_S]
        for name in silent:
            one = self._vehicles.pop(name)
            self._do(name, one, one.vehicle.lose_sight(now_s))  # what is sought for it is of no use
            self._seeker.forget(name)
            self._is_full = False
        return bool(silent)

    def _do(self, name: VehicleName, one: _Followed, commands: list[Command]) -> None:
        for command in commands:
            if isinstance(command, TakeFix):
                self._seeker.seek(one.fleet, name, command.attempt)
            elif isinstance(command, DropFix):
                self._seeker.drop(name, command.attempt)
            else:
                self._send(name, command)
        if one.vehicle.line != one.told:
            one.told = one.vehicle.line
            self._log.write(str(name), one.told)

    def _send(self, name: VehicleName, command: Send) -> None:
        now = datetime.now(timezone.utc)
        body = command.action.message(name, command.version, next(self._header_ids), now)
        if not self._publish(name.topic(INSTANT_ACTIONS), body):
            self._log.write(str(name), f"{command.action.kind} was not sent: no connection")
