"""A test of many cases fails if one of them fails, and names it."""

import inspect

import pytest

from tests.every_case import every_case


def test_all_cases_run_and_failed_ones_are_named():
    ran = []

    @every_case(("number", "text"), [(0, "a"), (1, "b"), (2, "c"), (3, "d")])
    def check(number: int, text: str) -> None:
        ran.append(number)
        assert number != 1
        with pytest.raises(ValueError, match="right"):
            raise ValueError("wrong" if text == "d" else "right")

    with pytest.raises(AssertionError, match=r"(?s)2 of 4 cases failed.*\[1, 'b'\].*\[3, 'd'\]"):
        check()
    assert ran == [0, 1, 2, 3]


@every_case("number", [1, 2], ids=["one", "two"])
@every_case("letter", "ab", ids=str.upper)
def test_decorators_combine_with_each_other_and_with_fixtures(number, letter, tmp_path):
    path = tmp_path / f"{number}{letter}"
    assert not path.exists()
    path.touch()


def test_pytest_sees_only_the_fixtures():
    test = test_decorators_combine_with_each_other_and_with_fixtures
    assert list(inspect.signature(test).parameters) == ["tmp_path"]
