"""The page of limits: what settings and the machine change of it."""

from __future__ import annotations

from firstfix_service.limits.limits import Limits
from firstfix_service.settings import Settings


def limits_of(**settings: object) -> Limits:
    return Limits.of(Settings(store="memory://", **settings))


def test_the_limits_that_are_settings_have_their_values():
    limits = limits_of(workers=3, queue_size=0, max_body_bytes=7, max_upload_bytes=8, answer_timeout_s=2.5)
    assert (limits.workers, limits.queue_size, limits.max_body_bytes) == (3, 0, 7)
    assert (limits.max_upload_bytes, limits.answer_timeout_s) == (8, 2.5)
    assert limits.max_unsent_bytes == Settings.model_fields["max_unsent_bytes"].default


def test_callers_have_no_rate_on_loopback_unless_it_is_set():
    limits = limits_of()
    assert limits.localize_per_s == limits.build_minutes_per_day == limits.changes_per_min == 0
    assert limits.builds_per_hour == limits.max_builds_per_caller == 0
    limits = limits_of(localize_per_s=2.0, build_minutes_per_day=4800.0)
    assert (limits.localize_per_s, limits.builds_per_hour, limits.max_builds_per_caller) == (2.0, 200.0, 50)
    assert limits.changes_per_min == 0


def test_callers_have_rates_where_other_machines_reach_the_service():
    limits = limits_of(host="0.0.0.0")
    assert (limits.localize_per_s, limits.build_minutes_per_day, limits.changes_per_min) == (50, 1440, 60)
    assert (limits.builds_per_hour, limits.max_builds_per_caller) == (60, 50)
    limits = limits_of(host="0.0.0.0", localize_per_s=0.0, build_minutes_per_day=0.0)
    assert limits.localize_per_s == limits.builds_per_hour == limits.max_builds_per_caller == 0
