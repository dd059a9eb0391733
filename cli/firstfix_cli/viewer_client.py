"""A client of the service with calls that a viewer needs and a robot does not."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from firstfix.catalog.recorded_queries import RecordedQuery
from firstfix.errors import FirstfixError
from firstfix_client import Client, RetryPolicy

from .arguments import PATIENCE_S, service_url

TIMEOUT_S = 60.0


class ViewerClient(Client):
    """Client that also reads recorded queries and clouds. Its errors are those of ``Client``."""

    @classmethod
    def at(cls, url: str | None) -> ViewerClient:
        """Client of the service at ``url``, or at the default one."""
        return cls(service_url(url), timeout_s=TIMEOUT_S, retry=RetryPolicy(patience_s=PATIENCE_S))

    def cloud(self, map_id: str, version: str) -> Mapping[str, Any]:
        """The index of a version's points in levels of detail, as the service's JSON.

        Raises:
            NotFound: no such map or version, or the version has no cloud.
        """
        path = ("maps", map_id, "versions", version, "cloud")
        return self._http.run(self._http.steps.sender.call("GET", *path)).parsed(dict)

    def cloud_points(self, map_id: str, version: str, first: int, count: int) -> bytes:
        """Some of the points that ``cloud`` lists, 8 bytes each, at most 500,000."""
        path = ("maps", map_id, "versions", version, "cloud", "points")
        params = {"first": str(first), "count": str(count)}
        return self._http.run(self._http.steps.sender.call("GET", *path, params=params)).body

    def cloud_intensity(self, map_id: str, version: str, first: int, count: int) -> bytes:
        """The intensity of some of the points that ``cloud`` lists, a byte each, at most 500,000."""
        path = ("maps", map_id, "versions", version, "cloud", "intensity")
        params = {"first": str(first), "count": str(count)}
        return self._http.run(self._http.steps.sender.call("GET", *path, params=params)).body

    def recorded_queries(self, map_id: str | None = None) -> Iterator[RecordedQuery]:
        """Yield the recorded queries, of one map or all, newest first, with one page of them in memory.

        Raises:
            FirstfixError: the service sent something else.
        """
        params = {} if map_id is None else {"map_id": map_id}
        for record in self._http.items(
            self._http.steps.sender.pages("queries", dict, "recorded-queries", params=params)
        ):
            yield _query_of(record)

    def recorded_query(self, query_id: str) -> RecordedQuery:
        """One recorded query.

        Raises:
            NotFound: no such recorded query.
        """
        return _query_of(
            self._http.run(self._http.steps.sender.call("GET", "recorded-queries", query_id)).parsed(dict)
        )

    def set_truth(self, query_id: str, truth: Mapping[str, Any]) -> None:
        """Note where the scan of a recorded query was taken; empty: it is not known.

        Raises:
            NotFound: no such recorded query.
        """
        path = ("recorded-queries", query_id, "truth")
        sender = self._http.steps.sender
        self._http.run(sender.call("PUT", *path, json=dict(truth)) if truth else sender.call("DELETE", *path))

    def recorded_body(self, query_id: str) -> bytes:
        """The body of a recorded query as it came.

        Raises:
            NotFound: no such recorded query.
        """
        return self._http.run(self._http.steps.sender.call("GET", "recorded-queries", query_id, "body")).body


def _query_of(record: Mapping[str, Any]) -> RecordedQuery:
    try:
        return RecordedQuery(**{**record, "truth": record["truth"] or {}})
    except (TypeError, KeyError) as error:
        raise FirstfixError(f"the service sent a recorded query that cannot be read: {error!r}") from None
