"""No test passes or fails by the time that something takes: on a busy machine everything takes longer."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from waiting import LIMIT_S, wait_until

TESTS = Path(__file__).parents[1]
CLOCKS = {"monotonic", "perf_counter", "process_time", "monotonic_ns", "perf_counter_ns"}
HOME = "waiting.py"  # where clocks are read and time is let pass
STEP_S = 0.1  # between two looks in a loop; whoever wants more has ``let_pass``
HANG_S = 60  # from here on it is a program that hangs, and is killed


def is_clock(node: ast.AST) -> bool:
    if not isinstance(node, ast.Call):
        return False
    name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
    return name in CLOCKS


def is_duration(node: ast.AST) -> bool:
    """A constant is taken from a clock to name a moment."""
    if not (isinstance(node, ast.BinOp) and isinstance(node.op, ast.Sub)):
        return False
    return is_clock(node.left) and not isinstance(node.right, ast.Constant)


def is_sleep(node: ast.AST) -> bool:
    return (
        isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and node.func.attr == "sleep"
        and getattr(node.func.value, "id", "") in {"time", "asyncio"}
    )


def faults(source: str) -> Iterator[str]:
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.Compare) and any(is_clock(one) for one in ast.walk(node)):
            yield f"line {node.lineno} compares what a clock shows"
        if is_duration(node):
            yield f"line {node.lineno} takes a duration"
        if is_sleep(node):
            (asked,) = node.args
            if not isinstance(asked, ast.Constant) or STEP_S < asked.value < HANG_S:
                yield f"line {node.lineno} sleeps in place of waiting for an event"


@pytest.mark.parametrize(
    ("source", "seen"),
    [
        ("assert time.monotonic() - began < 2", 2),
        ("while time.monotonic() < end: pass", 1),
        ("took_s = time.perf_counter() - began", 1),
        ("time.sleep(0.5)", 1),
        ("await asyncio.sleep(wait_s)", 1),
        ("ask(deadline=time.monotonic() + 0.1)", 0),
        ("refused_at = time.monotonic() - 1", 0),
        ("while not there(): time.sleep(0.02)", 0),
        ("time.sleep(600)", 0),
    ],
)
def test_a_time_that_decides_is_seen(source: str, seen: int):
    assert len(list(faults(source))) == seen


def judges_nothing(path: Path) -> bool:
    """Returns whether the file is of a fault drill, which is run by hand, or of those that end what hangs."""
    rooms = (TESTS / "faults", TESTS / "harness")
    return any(room in path.parents for room in rooms) and not path.name.startswith("test_")


def test_no_test_is_decided_by_time():
    found = {
        str(path.relative_to(TESTS)): seen
        for path in TESTS.rglob("*.py")
        if path.name != HOME and not judges_nothing(path) and (seen := list(faults(path.read_text())))
    }
    assert found == {}, "waiting.py has wait_until for what must happen, let_pass for what must not"


def test_who_waits_in_vain_says_for_what():
    with pytest.raises(AssertionError, match=r"waited 0\.1 s in vain for: .*LIMIT_S < 1"):
        wait_until(lambda: LIMIT_S < 1, 0.1)
    with pytest.raises(AssertionError, match="in vain for: the moon"):
        wait_until(lambda: False, 0.1, "the moon")
