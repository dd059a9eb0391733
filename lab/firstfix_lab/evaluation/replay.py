"""Replay of recorded queries: the old answers beside the new ones."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.catalog.recorded_queries import MAX_DECODED_BYTES, REPLAY, RecordedQueries, RecordedQuery
from firstfix.errors import FirstfixError
from firstfix.transform import Matrix, pose_error
from firstfix_cli.answerer import fetch_active_version, is_provisional
from firstfix_cli.arguments import client_of

BodyAnswerer = Callable[[RecordedQuery, bytes, LocalizeOptions], Localization]


@dataclass(frozen=True)
class Replayed:
    """One recorded query with its old and its new answer.

    Attributes:
        now: None if the query failed; ``error`` says why.
        moved_m, moved_deg: from the old first hypothesis to the new one; None without one, or if it is in
            another map.
    """

    recorded: RecordedQuery
    then: Localization
    now: Localization | None
    error: str
    moved_m: float | None
    moved_deg: float | None


def replay(
    recorded_queries: RecordedQueries, map_id: str, ask: BodyAnswerer, version: str | None = None
) -> Iterator[Replayed]:
    """Send every recorded query about the map again, oldest first.

    Args:
        version: version to ask; None: the active one.
    """
    for recorded in recorded_queries.each():
        if not recorded.is_about(map_id):
            continue
        then = Localization.from_mapping(recorded.answer)
        given = {k: v for k, v in recorded.options.items() if k not in ("version", "deadline_ms")}
        now, error = None, ""
        try:
            options = replace(LocalizeOptions.from_strings(given), version=version)
            now = ask(recorded, recorded_queries.body(recorded.query_id), options)
        except FirstfixError as problem:
            error = f"{problem} ({problem.code})"
        yield Replayed(recorded, then, now, error, *_moved(map_id, then, now))


@contextmanager
def body_answerer(
    map_id: str, *, url: str | None, store: str | None, timeout_s: float
) -> Iterator[BodyAnswerer]:
    """Give a function that answers a recorded query, with the service or with the store.

    Raises:
        NotFound: no such map.
    """
    if store is not None:
        yield _in_process(map_id, store)
        return
    with client_of(url, timeout_s) as client:
        yield lambda recorded, body, options: client.localize_body(
            body,
            recorded.media_type,
            map_id=map_id,
            options=options,
            content_encoding=recorded.content_encoding,
            request_id=f"{REPLAY}{recorded.query_id}",
        )


def _in_process(map_id: str, store: str) -> BodyAnswerer:
    from firstfix.decode import decode_query
    from firstfix.engine.index import MapIndex
    from firstfix.engine.localizer import Localizer
    from firstfix.wire.content_encoding import undo_content_encoding

    loaded: dict[str | None, tuple[str, Localizer, bool]] = {}

    def answer(recorded: RecordedQuery, body: bytes, options: LocalizeOptions) -> Localization:
        if options.version not in loaded:
            version, directory = fetch_active_version(store, map_id, options.version)
            localizer = Localizer(MapIndex.load(directory))
            loaded[options.version] = version, localizer, is_provisional(store, map_id, version)
        version, localizer, provisional = loaded[options.version]
        plain = undo_content_encoding(body, recorded.content_encoding, MAX_DECODED_BYTES)
        found = localizer.localize(decode_query(plain, recorded.media_type), options)
        return found.of_version(map_id, version, provisional=provisional)

    return answer


def _best(map_id: str, answer: Localization) -> Matrix | None:
    if answer.T_map_sensor is not None:
        return answer.T_map_sensor if answer.map_id == map_id else None
    first = answer.hypotheses[0] if answer.hypotheses else None
    return first.T_map_sensor if first is not None and first.map_id in ("", map_id) else None


def _moved(map_id: str, then: Localization, now: Localization | None) -> tuple[float | None, float | None]:
    before, after = _best(map_id, then), None if now is None else _best(map_id, now)
    if before is None or after is None:
        return None, None
    return pose_error(before, after)


def report_of(replayed: Sequence[Replayed]) -> dict[str, Any]:
    """The figures that ``--json`` writes."""
    changes = Counter((one.then.verdict.value, _verdict(one)) for one in replayed)
    return {
        "n": len(replayed),
        "changes": [{"then": then, "now": now, "n": count} for (then, now), count in sorted(changes.items())],
        "queries": [
            {
                "query": one.recorded.query_id,
                "then": _row_of(one.then),
                "now": None if one.now is None else _row_of(one.now),
                "error": one.error,
                "moved_m": one.moved_m,
                "moved_deg": one.moved_deg,
            }
            for one in replayed
        ],
    }


def lines_of(replayed: Sequence[Replayed]) -> list[str]:
    """One line for each query, then the counts of changes."""
    lines = [f"{'query':31} {'then':>17} {'now':>17}  best place"]
    for one in replayed:
        now = one.error or _short(one.now)
        moved = "" if one.moved_m is None else f"moved {one.moved_m:.2f} m, {one.moved_deg:.1f} deg"
        lines.append(f"{one.recorded.query_id:31} {_short(one.then):>17} {now:>17}  {moved}".rstrip())
    changes = Counter((one.then.verdict.value, _verdict(one)) for one in replayed)
    lines.append(f"{len(replayed)} recorded queries sent again")
    lines += [f"  {then} -> {now}: {count}" for (then, now), count in sorted(changes.items())]
    return lines


def _verdict(one: Replayed) -> str:
    return "error" if one.now is None else one.now.verdict.value


def _short(answer: Localization | None) -> str:
    return "" if answer is None else f"{answer.verdict.value} {answer.probability:.3f}"


def _row_of(answer: Localization) -> dict[str, Any]:
    return {
        "verdict": answer.verdict.value,
        "reasons": [reason.value for reason in answer.reasons],
        "probability": float(np.round(answer.probability, 6)),
        "map_version": answer.map_version,
    }
