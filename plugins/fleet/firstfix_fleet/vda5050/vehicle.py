"""The rules of one vehicle: when it is asked for, and what it is sent. No transport, no thread, no clock.

A vehicle that says that it is lost, stands still and has nothing to do is asked for. The fix is sent only if
it still is so, and has been so since the scan was wanted. What was sent is followed to its end.

    RESTING     it knows its position, or has not said
    WAITING     it is lost: until it may be asked for
    ASKING      its scan is taken and searched in the maps
    ACTING      an instant action was sent
    CONFIRMING  initPosition has FINISHED: until the vehicle says that it knows its position
"""

from __future__ import annotations

import random
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from .fleet_maps import FleetMaps
from .instant_actions import INIT_POSITION, InstantAction, enable_map, init_position
from .messages import State, VehicleMap
from .planar_fix import NoFix, PlanarFix


class Phase(Enum):
    """Phase of the gateway's work on a vehicle."""

    RESTING = "resting"
    WAITING = "waiting"
    ASKING = "asking"
    ACTING = "acting"
    CONFIRMING = "confirming"


@dataclass(frozen=True)
class Patience:
    """Times of the rules, in seconds.

    Attributes:
        settle_s: a vehicle is lost and stands still for so long before it is asked for.
        silence_s: age of a state that is no longer believed. A vehicle sends one every 30 s at least.
        order_s: after an order was sent to it, for so long no pose is.
        retry_s, max_retry_s: wait after a try without success; it doubles.
        accept_s: from an instant action to its first state.
        act_s: from an instant action to its end.
        confirm_s: from the end of initPosition to a state with a known position.
    """

    settle_s: float = 2.0
    silence_s: float = 40.0
    order_s: float = 10.0
    retry_s: float = 5.0
    max_retry_s: float = 120.0
    accept_s: float = 15.0
    act_s: float = 120.0
    confirm_s: float = 15.0


@dataclass(frozen=True)
class TakeFix:
    """Command: take the vehicle's scan and ask. Its outcome goes to ``Vehicle.take_outcome``."""

    attempt: int


@dataclass(frozen=True)
class DropFix:
    """Command: the outcome of this attempt is no longer of use."""

    attempt: int


@dataclass(frozen=True)
class Send:
    """Command: send an instant action now, or never."""

    action: InstantAction
    version: str


Command = TakeFix | DropFix | Send


class Vehicle:
    """One vehicle. Every method takes the time and returns commands, in their order.

    Args:
        new_id: makes an actionId.
        random_share: 0..1, so that many vehicles do not try again at the same time.

    Attributes:
        line: what a person should know about it now; empty: nothing.
    """

    def __init__(
        self,
        maps: FleetMaps,
        patience: Patience,
        *,
        new_id: Callable[[], str] = lambda: str(uuid.uuid4()),
        random_share: Callable[[], float] = random.random,
    ) -> None:
        self.phase = Phase.RESTING
        self.line = ""
        self._maps, self._patience = maps, patience
        self._new_id, self._random_share = new_id, random_share
        self._is_online: bool | None = None
        self._is_lost: bool | None = None
        self._state_s: float | None = None
        self._order_s: float | None = None
        self._obstacle, self._last_node_id, self._version = "", "", ""
        self._stored: tuple[VehicleMap, ...] | None = None
        self._attempt, self._failures, self._next_try_s = 0, 0, 0.0
        self._reason = ""  # of the last try without success
        self._fix: PlanarFix | None = None
        self._action: InstantAction | None = None
        self._status, self._result = "", ""  # of self._action, as the vehicle says
        self._sent_s = self._finished_s = 0.0
        self._succeeded_s: float | None = None

    @property
    def is_lost(self) -> bool | None:
        """True if the vehicle says that it does not know its position; None if it has not said."""
        return self._is_lost

    def take_connection(self, is_online: bool, now_s: float) -> list[Command]:
        """Take what the vehicle's connection is."""
        self._is_online = is_online
        if not is_online:  # what it said before may be wrong when it comes back
            self._state_s = None
        return self.tick(now_s)

    def take_state(self, state: State, now_s: float) -> list[Command]:
        """Take a state that the vehicle sends now."""
        own = frozenset() if self._action is None else frozenset((self._action.action_id,))
        shown = next((one for one in state.actions() if one.action_id in own), None)
        self._status, self._result = ("", "") if shown is None else (shown.action_status[:20], shown.result)
        self._is_lost, self._obstacle = state.is_lost, state.obstacle(own)
        self._last_node_id, self._version = state.last_node_id, state.version
        self._stored, self._state_s = self._maps.known(state.maps), now_s
        return self.tick(now_s)

    def take_order(self, now_s: float) -> list[Command]:
        """Take note that somebody sends the vehicle an order, which its state does not show yet."""
        self._order_s = now_s
        return self.tick(now_s)

    def lose_sight(self, now_s: float) -> list[Command]:
        """Take note that messages may have been missed: nothing is known before it speaks again."""
        self._is_online = self._state_s = None
        return self.tick(now_s)

    def take_outcome(self, attempt: int, outcome: PlanarFix | NoFix, now_s: float) -> list[Command]:
        """Take the outcome of an attempt. One that was dropped is ignored."""
        commands = self.tick(now_s)
        if self.phase is Phase.ASKING and attempt == self._attempt:
            if isinstance(outcome, NoFix):
                self._fail(outcome.reason, now_s)
            else:
                self._fix = outcome
                commands += self._act(outcome, now_s)
            self._tell(now_s)
        return commands

    def tick(self, now_s: float) -> list[Command]:
        """Let time pass. Call it about once a second."""
        commands: list[Command] = []
        if self.phase is Phase.RESTING and self._is_lost:
            self._begin(now_s)
        if self.phase in (Phase.WAITING, Phase.ASKING):
            commands += self._wait_or_ask(now_s)
        elif self.phase is Phase.ACTING:
            commands += self._follow(now_s)
        if self.phase is Phase.CONFIRMING:
            self._confirm(now_s)
        self._tell(now_s)
        return commands

    def obstacle(self, now_s: float) -> str:
        """Why it may be sent nothing now; empty if it may."""
        if not self._is_online:
            return "it has not said that it is ONLINE" if self._is_online is None else "it is not ONLINE"
        if self._state_s is None or now_s - self._state_s > self._patience.silence_s:
            return "it sends no state"
        if self._order_s is not None and now_s - self._order_s < self._patience.order_s:
            return "it was sent an order"
        return self._obstacle

    def _begin(self, now_s: float) -> None:
        succeeded_s = self._succeeded_s
        if succeeded_s is not None and now_s - succeeded_s < self._patience.max_retry_s:
            self._fail("it has lost its position again", now_s)
        else:
            self.phase, self._failures, self._reason = Phase.WAITING, 0, ""
            self._next_try_s = now_s + self._patience.settle_s

    def _wait_or_ask(self, now_s: float) -> list[Command]:
        commands: list[Command] = []
        blocked = bool(self.obstacle(now_s))
        if self.phase is Phase.ASKING and (blocked or not self._is_lost):
            commands.append(DropFix(self._attempt))
            self.phase = Phase.WAITING
        if not self._is_lost:
            self.phase = Phase.RESTING
        elif blocked:
            self._next_try_s = max(self._next_try_s, now_s + self._patience.settle_s)
        elif self.phase is Phase.WAITING and now_s >= self._next_try_s:
            self.phase = Phase.ASKING
            self._attempt += 1
            commands.append(TakeFix(self._attempt))
        return commands

    def _act(self, fix: PlanarFix, now_s: float) -> list[Command]:
        """Send the next action towards the fix: the map first, if the vehicle does not use it."""
        target = self._maps.choose(fix, self._stored)
        if isinstance(target, NoFix):
            self._fail(target.reason, now_s)
            return []
        action_id = self._new_id()
        if target.enable is not None:
            if self._action is not None:
                self._fail(
                    f"it does not use version {target.enable!r} of {target.map_id!r} after enableMap", now_s
                )
                return []
            self._action = enable_map(action_id, target.map_id, target.enable)
        else:
            self._action = init_position(action_id, target.fix, target.map_id, self._last_node_id)
        self.phase, self._sent_s = Phase.ACTING, now_s
        self._status = self._result = ""
        return [Send(self._action, self._version)]

    def _follow(self, now_s: float) -> list[Command]:
        action, status, since_s = self._action, self._status, now_s - self._sent_s
        assert action is not None
        if action.kind != INIT_POSITION and self.obstacle(now_s):
            self._fix = None  # it may have moved since its scan was taken
        if status == "FAILED":
            self._fail(f"{action.kind} FAILED" + (f": {self._result}" if self._result else ""), now_s)
        elif status == "FINISHED" and action.kind == INIT_POSITION:
            self.phase, self._finished_s = Phase.CONFIRMING, now_s
        elif status == "FINISHED" and (self._fix is None or not self._is_lost):
            self._fail("it was moved while it changed its map", now_s)
        elif status == "FINISHED" and self._fix is not None:
            return self._act(self._fix, now_s)
        elif not status and since_s > self._patience.accept_s:
            if self._is_lost is False:  # an order may have cleared the states
                self._succeed(now_s)
            else:
                self._fail(f"it shows no state of {action.kind}", now_s)
        elif since_s > self._patience.act_s:
            self._fail(f"{action.kind} is {status} for too long", now_s)
        return []

    def _confirm(self, now_s: float) -> None:
        if self._is_lost is False:
            self._succeed(now_s)
        elif now_s - self._finished_s > self._patience.confirm_s:
            self._fail("initPosition is FINISHED, and it does not know its position", now_s)

    def _fail(self, reason: str, now_s: float) -> None:
        patience = self._patience
        wait_s = min(patience.retry_s * 2.0 ** min(self._failures, 30), patience.max_retry_s)
        self.phase, self._reason, self._action = Phase.WAITING, reason, None
        self._failures += 1
        self._next_try_s = now_s + wait_s * (0.5 + self._random_share() / 2)

    def _succeed(self, now_s: float) -> None:
        self._succeeded_s = now_s
        self.phase, self._action, self._reason = Phase.RESTING, None, ""

    def _tell(self, now_s: float) -> None:
        if self.phase is Phase.RESTING and self._is_lost is False:
            self.line = "knows its position"
        elif self.phase is Phase.WAITING:
            self.line = f"lost: {self.obstacle(now_s) or self._reason or 'waits to be asked for'}"
        elif self.phase is Phase.ACTING and self._action is not None:
            self.line = f"{self._action} is {self._status or 'sent'}"
