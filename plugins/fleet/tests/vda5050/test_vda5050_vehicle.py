"""The rules of one vehicle: examples, and what holds for every course of events."""

from __future__ import annotations

import itertools
import json
from typing import Any

import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st

from firstfix_fleet.vda5050.fleet_maps import FleetMap, FleetMaps
from firstfix_fleet.vda5050.messages import Sender, State, read_message
from firstfix_fleet.vda5050.planar_fix import NoFix, PlanarFix
from firstfix_fleet.vda5050.vehicle import Command, DropFix, Patience, Phase, Send, TakeFix, Vehicle
from plugins.fleet.tests.vda5050_vehicle import MANUFACTURER, state

VERSION = "ab" * 32
FIX = PlanarFix("hall", VERSION, 1.0, 2.0, 0.5)
PATIENCE = Patience()
SETTLED_S = PATIENCE.settle_s


def read(**changed: Any) -> State:
    body = json.dumps(state(**changed)).encode()
    return read_message(State, body, Sender(MANUFACTURER, "agv1"))


def action(action_id: str, status: str, kind: str = "initPosition", **more: str) -> dict[str, str]:
    return {"actionId": action_id, "actionType": kind, "actionStatus": status, **more}


def vehicle(versions: dict[str, str] | None = None) -> Vehicle:
    ids = itertools.count()
    maps = FleetMaps({"hall": FleetMap("HALL", versions or {})})
    return Vehicle(maps, PATIENCE, new_id=lambda: f"action{next(ids)}", random_share=lambda: 1.0)


def asked(one: Vehicle, **changed: Any) -> float:
    """Brings a vehicle to where it is asked for. Returns the time."""
    one.take_connection(True, 0.0)
    assert one.take_state(read(**changed), 0.0) == []
    assert one.take_state(read(**changed), SETTLED_S) == [TakeFix(1)]
    return SETTLED_S


def sent(commands: list[Command]) -> list[tuple[str, dict[str, str | float]]]:
    return [(one.action.kind, dict(one.action.parameters)) for one in commands if isinstance(one, Send)]


def test_a_lost_vehicle_gets_its_position_and_is_followed_to_the_end():
    one = vehicle()
    now_s = asked(one)
    commands = one.take_outcome(1, FIX, now_s)
    pose = {"x": 1.0, "y": 2.0, "theta": 0.5, "mapId": "HALL", "lastNodeId": "node7"}
    assert sent(commands) == [("initPosition", pose)]
    for status in ("WAITING", "RUNNING"):
        assert one.take_state(read(actionStates=[action("action0", status)]), now_s + 1) == []
        assert status in one.line
    assert one.take_state(read(actionStates=[action("action0", "FINISHED")]), now_s + 2) == []
    assert one.phase is Phase.CONFIRMING
    assert one.take_state(read(lost=False), now_s + 3) == []
    assert (one.phase, one.line) == (Phase.RESTING, "knows its position")


@pytest.mark.parametrize("version", ["2.0.0", "2.1.0", "3.0.0"])
def test_an_action_has_the_names_of_the_vehicles_version(version: str):
    one = vehicle()
    now_s = asked(one, version=version)
    [command] = one.take_outcome(1, FIX, now_s)
    assert isinstance(command, Send)
    assert command.version == version


BLOCKED = {
    "drives": {"driving": True},
    "moves": {"velocity": {"vx": 0.3}},
    "turns": {"velocity": {"omega": -0.3}},
    "nodes": {"nodeStates": [{"nodeId": "a", "sequenceId": 0, "released": True}]},
    "edges": {"edgeStates": [{"edgeId": "a", "sequenceId": 1, "released": False}]},
    "an action runs": {"actionStates": [action("x", "RUNNING", "pick")]},
    "an action waits": {"actionStates": [action("x", "WAITING", "pick")]},
    "another's initPosition": {"actionStates": [action("x", "INITIALIZING")]},
    "an action may be tried again": {"version": "3.0.0", "actionStates": [action("x", "RETRIABLE", "pick")]},
    "an instant action runs": {"version": "3.0.0", "instantActionStates": [action("x", "PAUSED", "a")]},
    "an action of a zone runs": {"version": "3.0.0", "zoneActionStates": [action("x", "RUNNING", "a")]},
    "manual": {"operatingMode": "MANUAL"},
    "starts up": {"version": "3.0.0", "operatingMode": "STARTUP"},
}


@pytest.mark.parametrize("changed", BLOCKED.values(), ids=BLOCKED)
def test_a_vehicle_that_is_not_free_is_neither_asked_for_nor_sent_anything(changed: dict[str, Any]):
    one = vehicle()
    one.take_connection(True, 0.0)
    for now_s in range(20):
        assert one.take_state(read(**changed), float(now_s)) == []
    assert one.line.startswith("lost: its " if "its" in one.line else "lost: it ")
    one = vehicle()
    now_s = asked(one)
    assert one.take_state(read(**changed), now_s + 1) == [DropFix(1)]
    assert one.take_state(read(), now_s + 2) == []
    assert one.take_outcome(1, FIX, now_s + 2) == [], "it stands still again, but where?"
    assert one.take_state(read(), now_s + 2 + SETTLED_S) == [TakeFix(2)]


def test_a_vehicle_that_is_offline_or_silent_or_was_sent_an_order_waits():
    one = vehicle()
    now_s = asked(one)
    assert one.take_connection(False, now_s) == [DropFix(1)]
    one = vehicle()
    now_s = asked(one)
    assert one.take_order(now_s) == [DropFix(1)]
    assert one.line == "lost: it was sent an order"
    one = vehicle()
    now_s = asked(one)
    assert one.tick(now_s + PATIENCE.silence_s + 1) == [DropFix(1)]
    one = vehicle()
    now_s = asked(one)
    assert one.lose_sight(now_s) == [DropFix(1)]
    assert one.take_state(read(), now_s + 5) == []
    assert one.line == "lost: it has not said that it is ONLINE"


def test_a_finished_order_is_no_obstacle_and_no_word_of_a_position_is_no_wish():
    done = {
        "orderId": "order1",
        "actionStates": [action("x", "FINISHED", "pick"), action("y", "FAILED", "drop")],
    }
    asked(vehicle(), **done)
    one = vehicle()
    one.take_connection(True, 0.0)
    silent = state()
    del silent["agvPosition"]
    message = read_message(State, json.dumps(silent).encode(), Sender(MANUFACTURER, "agv1"))
    assert [one.take_state(message, float(now_s)) for now_s in range(9)] == [[]] * 9
    assert one.phase is Phase.RESTING


def test_no_fix_is_named_and_tried_again_later_and_later():
    one = vehicle()
    now_s, waits_s = asked(one), []
    for attempt in range(1, 8):
        assert one.take_outcome(attempt, NoFix("the scan is ambiguous"), now_s) == []
        assert one.line == "lost: the scan is ambiguous"
        failed_s = now_s
        while one.take_state(read(), now_s) == []:
            now_s += 1
        waits_s.append(now_s - failed_s)
    assert waits_s == [5, 10, 20, 40, 80, 120, 120]


def test_actions_that_fail_or_are_never_shown_are_named():
    one = vehicle()
    now_s = asked(one)
    one.take_outcome(1, FIX, now_s)
    one.take_state(
        read(actionStates=[action("action0", "FAILED", resultDescription="not on the map")]), now_s
    )
    assert one.line == "lost: initPosition FAILED: not on the map"
    one = vehicle()
    now_s = asked(one)
    one.take_outcome(1, FIX, now_s)
    one.take_state(read(), now_s + PATIENCE.accept_s + 1)
    assert one.line == "lost: it shows no state of initPosition"
    one = vehicle()
    now_s = asked(one)
    one.take_outcome(1, FIX, now_s)
    for later_s in (1, PATIENCE.confirm_s + 2):
        one.take_state(read(actionStates=[action("action0", "FINISHED")]), now_s + later_s)
    assert "does not know its position" in one.line


def test_a_vehicle_that_loses_its_position_again_and_again_is_asked_for_later_and_later():
    one, waits_s = vehicle(), []
    now_s = asked(one)
    for attempt in range(1, 6):
        [command] = one.take_outcome(attempt, FIX, now_s)
        assert isinstance(command, Send)
        one.take_state(
            read(lost=False, actionStates=[action(command.action.action_id, "FINISHED")]), now_s + 1
        )
        lost_s = now_s = now_s + 2
        while one.take_state(read(), now_s) == []:
            assert one.line == "lost: it has lost its position again"
            now_s += 1
        waits_s.append(now_s - lost_s)
    assert waits_s == [5, 10, 20, 40, 80]


def stored(*versions: tuple[str, str]) -> list[dict[str, str]]:
    return [{"mapId": "HALL", "mapVersion": name, "mapStatus": status} for name, status in versions]


def test_the_map_of_the_fix_is_enabled_first():
    one = vehicle({VERSION[:8]: "7"})
    before, after = (
        stored(("6", a), ("7", b)) for a, b in (("ENABLED", "DISABLED"), ("DISABLED", "ENABLED"))
    )
    now_s = asked(one, maps=before)
    commands = one.take_outcome(1, FIX, now_s)
    assert sent(commands) == [("enableMap", {"mapId": "HALL", "mapVersion": "7"})]
    one.take_state(read(maps=before, actionStates=[action("action0", "RUNNING", "enableMap")]), now_s + 1)
    done = [action("action0", "FINISHED", "enableMap")]
    commands = one.take_state(read(maps=after, actionStates=done), now_s + 2)
    assert [kind for kind, _ in sent(commands)] == ["initPosition"]


def test_a_vehicle_that_moved_while_it_changed_its_map_is_asked_for_anew():
    one = vehicle({VERSION[:8]: "7"})
    maps, done = stored(("7", "DISABLED")), [action("action0", "FINISHED", "enableMap")]
    now_s = asked(one, maps=maps)
    one.take_outcome(1, FIX, now_s)
    one.take_state(read(maps=maps, driving=True), now_s + 1)
    assert one.take_state(read(maps=stored(("7", "ENABLED")), actionStates=done), now_s + 2) == []
    assert "moved" in one.line


@pytest.mark.parametrize(
    ("maps", "versions", "says"),
    [
        ([], {}, "it has no map 'HALL'"),
        (stored(("6", "ENABLED")), {VERSION[:8]: "7"}, "it has no map 'HALL' of version '7'"),
        (stored(("6", "DISABLED"), ("7", "DISABLED")), {}, "2 versions of map 'HALL', and none is enabled"),
        (stored(("7", "ENABLED")), {"cd" * 4: "7"}, "has no mapVersion in the fleets' file"),
    ],
)
def test_a_map_that_the_vehicle_cannot_use_is_named(maps: Any, versions: dict[str, str], says: str):
    one = vehicle(versions)
    now_s = asked(one, maps=maps)
    assert one.take_outcome(1, FIX, now_s) == []
    assert says in one.line


FREE = {
    "lost": True,
    "driving": False,
    "nodeStates": [],
    "operatingMode": "AUTOMATIC",
    "own": "",
    "maps": None,
}
EVENTS = st.one_of(
    st.tuples(st.just("state"), st.just(FREE)),
    st.tuples(st.just("time"), st.just(SETTLED_S)),
    st.tuples(st.just("outcome"), st.just(FIX)),
    st.tuples(
        st.just("state"),
        st.fixed_dictionaries(
            {
                "lost": st.sampled_from([True, True, True, False]),
                "driving": st.sampled_from([False, False, False, True]),
                "nodeStates": st.sampled_from([[], [], [], [{}]]),
                "operatingMode": st.sampled_from(["AUTOMATIC", "AUTOMATIC", "MANUAL"]),
                "own": st.sampled_from(["", "RUNNING", "FINISHED", "FAILED"]),
                "maps": st.sampled_from([None, stored(("7", "ENABLED")), stored(("7", "DISABLED"))]),
            }
        ),
    ),
    st.tuples(st.just("connection"), st.sampled_from([True, True, False])),
    st.tuples(st.just("outcome"), st.sampled_from([FIX, FIX, NoFix("none")])),
    st.tuples(st.sampled_from(["order", "blind"]), st.none()),
    st.tuples(st.just("time"), st.sampled_from([0.5, 2.5, 6.0, 50.0])),
)


@settings(max_examples=120)
@given(st.lists(EVENTS, min_size=20, max_size=80))
def test_whatever_happens_a_position_is_sent_only_to_who_is_lost_and_has_stood_still_since_its_scan(events):
    """The oracle keeps what was said last, and whether anything forbade a position since the scan."""
    one, now_s = vehicle(), 0.0
    online, last, said_s, order_s, action_id = False, None, -1e9, -1e9, ""
    still = False  # since the scan of the newest attempt was wanted
    attempt, open_actions = 0, set()
    for kind, value in [("connection", True), *events]:
        commands: list[Command] = []
        if kind == "state":
            shown = [action(action_id, value["own"])] if value["own"] and action_id else []
            changed = {name: value[name] for name in ("lost", "driving", "nodeStates", "operatingMode")}
            maps = {} if value["maps"] is None else {"maps": value["maps"]}
            last, said_s = value, now_s
            if value["own"] in ("FINISHED", "FAILED"):
                open_actions.discard(action_id)
            still &= _is_free(last)
            commands = one.take_state(read(actionStates=shown, **changed, **maps), now_s)
        elif kind == "connection":
            online, still = value, still and value
            said_s = said_s if value else -1e9
            commands = one.take_connection(value, now_s)
        elif kind == "outcome":
            commands = one.take_outcome(attempt, value, now_s)
        elif kind == "order":
            order_s, still = now_s, False
            commands = one.take_order(now_s)
        elif kind == "blind":
            online, said_s, still = False, -1e9, False
            commands = one.lose_sight(now_s)
        else:
            now_s += value
            still &= now_s - said_s <= PATIENCE.silence_s
            commands = one.tick(now_s)
        for command in commands:
            if isinstance(command, TakeFix):
                assert command.attempt == attempt + 1
                attempt, still = command.attempt, True
            if isinstance(command, TakeFix | Send):
                assert online
                assert last is not None
                assert _is_free(last)
                assert last["lost"]
                assert now_s - said_s <= PATIENCE.silence_s
                assert now_s - order_s >= PATIENCE.order_s
            if isinstance(command, Send):
                event(command.action.kind)
                assert still
                action_id = command.action.action_id
                assert action_id not in open_actions
                open_actions.add(action_id)
        if last is not None and last["lost"] and one.phase is not Phase.ASKING:
            assert one.line, "a lost vehicle is always named"


def _is_free(last: dict[str, Any]) -> bool:
    return not last["driving"] and not last["nodeStates"] and last["operatingMode"] == "AUTOMATIC"
