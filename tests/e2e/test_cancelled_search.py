"""A cancelled query ends where it is, without an answer, and leaves nothing behind for the next one."""

import math
import mmap
from collections.abc import Callable

import pytest

from firstfix.engine.deadline import Deadline
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer, localize_among
from firstfix.engine.map_search import Step
from firstfix.engine.retrieval.cascade import Matches
from firstfix.errors import QueryCancelled
from firstfix.scan.condense import condense
from firstfix.scan.sequence import ScanSequence
from tests.e2e.test_ladder import NotingLocalizer, assert_equal, in_time, noise
from tests.python_cascade import PythonCascade, searched_by


def calling(index: MapIndex, call: Callable[[], None], at: int) -> tuple[MapIndex, list[int]]:
    """The index with a retrieval in Python, which calls something as one of its searches begins.

    Returns the searches, too.
    """
    searches: list[int] = []

    class CallingCascade(PythonCascade):
        def search(self, described, clusters: int) -> Matches:
            searches.append(clusters)
            if len(searches) == at:
                call()
            return super().search(described, clusters)

    return searched_by(index, CallingCascade), searches


@pytest.mark.parametrize("retrieval", ["compiled", "in Python"])
def test_a_query_that_is_cancelled_before_it_begins_searches_nothing(index, small_scans, retrieval):
    localizer = NotingLocalizer(index if retrieval == "compiled" else searched_by(index))
    (first, T_first), (second, T_second) = small_scans[:2]
    for scan in (
        first,
        condense(first),
        in_time(first),
        ScanSequence.along([first, second], [T_first, T_second]),
    ):
        deadline = Deadline()
        deadline.cancel()
        with pytest.raises(QueryCancelled):
            localizer.localize(scan, deadline=deadline)
        with pytest.raises(QueryCancelled):
            localize_among({"one": localizer, "other": localizer}, scan, deadline=deadline)
    assert localizer.searches == []


def test_a_query_that_is_cancelled_as_it_is_prepared_takes_no_step(index, small_scans):
    deadline = Deadline()

    class Cancelling(NotingLocalizer):
        def search(self, *given, **named):
            search = super().search(*given, **named)
            deadline.cancel()
            return search

    localizer = Cancelling(index)
    with pytest.raises(QueryCancelled):
        localizer.localize(small_scans[0][0], deadline=deadline)
    assert localizer.taken == []


@pytest.mark.parametrize("at", [1, 2, 5])
def test_a_query_that_is_cancelled_in_a_step_ends_in_it(index, at):
    scan = noise(1)
    counting, searches = calling(index, lambda: None, 0)
    whole = NotingLocalizer(counting).localize(scan)
    in_all = len(searches)
    assert in_all > 5, "a scan of another place climbs the whole ladder"
    deadline = Deadline()
    asked, searches = calling(index, deadline.cancel, at)
    localizer = NotingLocalizer(asked)
    with pytest.raises(QueryCancelled):
        localizer.localize(scan, deadline=deadline)
    assert len(searches) == at
    assert Step.EXHAUSTIVE not in localizer.taken
    assert_equal(localizer.localize(scan), whole)


def test_a_query_of_several_maps_ends_in_the_one_that_is_searched(index, small_scans):
    scan, deadline = noise(1), Deadline()
    asked, _ = calling(index, deadline.cancel, 2)
    one, other = NotingLocalizer(asked), NotingLocalizer(index)
    for likely_one in (False, True):
        with pytest.raises(QueryCancelled):
            localize_among({"one": one, "other": other}, scan, deadline=deadline, likely_one=likely_one)
    assert other.taken == [], "it would have come next"
    maps = {"one": Localizer(index), "other": Localizer(index)}
    wanted = localize_among(maps, small_scans[0][0])
    assert_equal(localize_among({"one": one, "other": other}, small_scans[0][0]), wanted)


def test_the_look_for_a_cause_is_cancelled_too(index, small_scans):
    scan, deadline = noise(1), Deadline()

    class Cancelling(Localizer):
        searches = 0

        def search(self, *given, **named):
            self.searches += 1
            if self.searches == 2:  # the scan in its first other form
                deadline.cancel()
            return super().search(*given, **named)

    localizer = Cancelling(index)
    with pytest.raises(QueryCancelled):
        localizer.localize(scan, deadline=deadline)
    assert localizer.searches == 2


def test_queries_that_share_a_word_are_cancelled_by_their_numbers(index, small_scans):
    """The word is in memory that another process may write, and this one may only read."""
    scan, wanted = small_scans[0][0], Localizer(index).localize(small_scans[0][0])
    with mmap.mmap(-1, mmap.PAGESIZE) as memory:
        word = memoryview(memory)[:8]
        localizer = Localizer(index)
        for number, cancelled in ((1, 0), (2, 1), (3, 2), (2**63 + 5, 5)):
            word.cast("Q")[0] = cancelled
            assert_equal(
                localizer.localize(scan, deadline=Deadline(math.inf, word.toreadonly(), number)), wanted
            )
            word.cast("Q")[0] = number
            with pytest.raises(QueryCancelled):
                localizer.localize(scan, deadline=Deadline(math.inf, word.toreadonly(), number))
        word.release()
        del localizer
