"""Messages of a vehicle, with the fields that the gateway reads: VDA 5050, versions 2.0, 2.1 and 3.0.

Only the fields that decide whether a fix is wanted, and whether it may be sent. All others are ignored, those
of newer versions too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic.alias_generators import to_camel

from firstfix.errors import MalformedData, TooLarge

MAX_STATE_BYTES = 1 << 20  # a state with a thousand nodes has 200 kB
ENDED = frozenset({"FINISHED", "FAILED"})
# Operating modes in which instant actions may be sent: table 1 of 2.1, table 5 of 3.0.
CONTROLLED = frozenset({"AUTOMATIC", "SEMIAUTOMATIC"})
STILL_M_S, STILL_RAD_S = 0.05, 0.05  # a faster vehicle moves, whatever `driving` says

_Id = Annotated[str, Field(max_length=256)]
_Text = Annotated[str, Field(max_length=65_536)]
_Message = TypeVar("_Message", bound="_Header")


class _Read(BaseModel):
    model_config = ConfigDict(
        extra="ignore", frozen=True, strict=True, allow_inf_nan=False, alias_generator=to_camel
    )


class _Header(_Read):
    version: Annotated[str, Field(pattern=r"^[0-9]{1,3}\.[0-9]{1,3}(\.[0-9]{1,3})?$")]
    manufacturer: _Id
    serial_number: _Id


class _Position(_Read):
    position_initialized: bool


class _RobotPosition(_Read):
    localized: bool


class _Velocity(_Read):
    vx: float | None = None
    vy: float | None = None
    omega: float | None = None


class VehicleMap(_Read):
    """A map that is stored on the vehicle."""

    map_id: _Id
    map_version: _Id
    map_status: _Id

    @property
    def is_enabled(self) -> bool:
        """True for the version in use of this map."""
        return self.map_status == "ENABLED"


class ActionState(_Read):
    """State of one action of an order, or of one instant action."""

    action_id: _Id
    action_type: _Id = ""
    action_status: _Id
    result_description: _Text | None = None
    action_result: _Text | None = None  # the name of resultDescription in 3.0

    @property
    def result(self) -> str:
        """The vehicle's own text about how the action ended; empty if it gave none."""
        return (self.result_description or self.action_result or "")[:200]


class State(_Header):
    """The message ``state``."""

    last_node_id: _Id
    driving: bool
    node_states: list[Any]
    edge_states: list[Any]
    action_states: list[ActionState]
    operating_mode: _Id
    instant_action_states: list[ActionState] = []
    zone_action_states: list[ActionState] = []
    maps: list[VehicleMap] | None = None
    agv_position: _Position | None = None
    mobile_robot_position: _RobotPosition | None = None
    velocity: _Velocity | None = None

    @property
    def is_lost(self) -> bool | None:
        """True if the vehicle says that it does not know its position; None if it does not say."""
        if self.mobile_robot_position is not None:
            return not self.mobile_robot_position.localized
        return None if self.agv_position is None else not self.agv_position.position_initialized

    def actions(self) -> Sequence[ActionState]:
        """All actions that the state has: 2.x lists instant actions with those of the order."""
        return (*self.action_states, *self.instant_action_states, *self.zone_action_states)

    def obstacle(self, own_actions: frozenset[str]) -> str:
        """Why the vehicle may be sent no pose now; empty if it may.

        Args:
            own_actions: ids of actions that the gateway has sent.
        """
        if self.driving or self._moves():
            return "it drives"
        if self.node_states or self.edge_states:
            return "its order is not finished"
        for action in self.actions():
            if action.action_status not in ENDED and action.action_id not in own_actions:
                return f"its action {action.action_type[:40]!r} is not finished"
        if self.operating_mode not in CONTROLLED:
            return f"its operating mode is {self.operating_mode[:40]}"
        return ""

    def _moves(self) -> bool:
        if self.velocity is None:
            return False
        return (
            math.hypot(self.velocity.vx or 0.0, self.velocity.vy or 0.0) > STILL_M_S
            or abs(self.velocity.omega or 0.0) > STILL_RAD_S
        )


class Connection(_Header):
    """The message ``connection``."""

    connection_state: _Id

    @property
    def is_online(self) -> bool:
        """True while the vehicle is connected and sends its state."""
        return self.connection_state == "ONLINE"


@dataclass(frozen=True)
class Sender:
    """Sender of a message, as its topic says."""

    manufacturer: str
    serial: str


def read_message(kind: type[_Message], body: bytes, sender: Sender) -> _Message:
    """Read a message.

    Raises:
        TooLarge: more than MAX_STATE_BYTES.
        MalformedData: not such a message, of a major version other than 2 and 3, or of another vehicle than
            its topic says.
    """
    name = kind.__name__.lower()
    if len(body) > MAX_STATE_BYTES:
        raise TooLarge(f"a {name} of {len(body)} bytes, the limit is {MAX_STATE_BYTES}")
    try:
        message = kind.model_validate_json(body)
    except ValidationError as error:
        raise MalformedData(f"not a {name} of VDA 5050: {_first(error)}") from None
    if (message.manufacturer, message.serial_number) != (sender.manufacturer, sender.serial):
        theirs = f"{message.manufacturer[:60]!r} {message.serial_number[:60]!r}"
        raise MalformedData(f"a {name} that says that it is of the vehicle {theirs}")
    if message.version.partition(".")[0] not in ("2", "3"):
        raise MalformedData(f"a {name} of version {message.version}: the versions 2 and 3 are known")
    return message


def _first(error: ValidationError) -> str:
    found = error.errors(include_url=False, include_input=False, include_context=False)[0]
    place = ".".join(str(part)[:60] for part in found["loc"][:4])
    return f"{place}: {found['msg'][:200]}" if place else found["msg"][:200]
