"""Pace at which answers are taken in: how long a caller may wait with an answer, by its size."""

from firstfix_service.http_server.streams import ReadingPace
from firstfix_service.limits.limits import Limits

ANSWER_S = 30.0
LARGE = 4_000_000


def is_cut_off(size_bytes: int, taken_per_s: float, seconds: int = 600) -> bool:
    """Returns whether a caller is too slow that takes an answer in at an even pace."""
    pace = ReadingPace(Limits(answer_timeout_s=ANSWER_S))
    pace.begin(size_bytes, 0)
    pace.wrote(size_bytes)
    pace.paused(0.0)
    left = (round(max(0, size_bytes - taken_per_s * second)) for second in range(seconds))
    return any(unsent and pace.is_too_slow(float(second), unsent) for second, unsent in enumerate(left))


def test_a_slow_network_may_take_a_short_answer_in_at_its_pace():
    assert not is_cut_off(100_000, 500)
    assert is_cut_off(100_000, 200)


def test_the_pace_grows_with_the_answer():
    for taken_per_s, cut_off in ((0, True), (750, True), (10_000, True), (15_000, False)):
        assert is_cut_off(LARGE, taken_per_s) is cut_off, taken_per_s


def test_a_pause_for_each_piece_does_not_begin_the_measurement_anew():
    pace, piece, now = ReadingPace(Limits(answer_timeout_s=ANSWER_S)), 65_536, 0.0
    pace.begin(LARGE, 0)
    for _ in range(3):
        pace.wrote(piece)
        pace.paused(now)
        now += 20.0  # less than a caller may wait with any answer
        if pace.is_too_slow(now, 0):
            return
        pace.resumed(now)
    raise AssertionError("a piece in 20 s is too slow for 4 MB")


def test_only_the_time_in_which_the_caller_takes_nothing_counts():
    pace = ReadingPace(Limits(answer_timeout_s=ANSWER_S))
    pace.begin(0, 0)
    for hour in range(10):  # a stream of events
        pace.wrote(100)
        assert not pace.is_too_slow(3600.0 * hour, 0)
    pace.paused(36_000.0)
    assert not pace.is_too_slow(36_029.0, 0)
    assert pace.is_too_slow(36_040.0, 0)


def test_what_an_earlier_answer_left_is_not_taken_for_this_one():
    pace = ReadingPace(Limits(answer_timeout_s=ANSWER_S))
    pace.begin(1000, 60_000)
    pace.wrote(1000)
    pace.paused(0.0)
    assert pace.is_too_slow(ANSWER_S + 1, 61_000)
    assert not pace.is_too_slow(ANSWER_S + 1, 60_000)
