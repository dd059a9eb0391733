"""A client of the service with calls that an operator needs and a robot does not."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from firstfix_client import Client, RetryPolicy

from .arguments import PATIENCE_S, service_url

TIMEOUT_S = 10.0


class OperatorClient(Client):
    """Client that also shows versions and builds, and removes maps. Its errors are those of ``Client``."""

    @classmethod
    def at(cls, url: str | None) -> OperatorClient:
        """Client of the service at ``url``, or at the default one."""
        return cls(service_url(url), timeout_s=TIMEOUT_S, retry=RetryPolicy(patience_s=PATIENCE_S))

    def version_details(self, map_id: str, version: str) -> Mapping[str, Any]:
        """One version with its manifest, and what it was made of, as the service's JSON.

        Raises:
            NotFound: no such map or version.
        """
        return self._get("maps", map_id, "versions", version)

    def delete_map(self, map_id: str) -> list[str]:
        """Take all versions of a map out of service, and return them.

        Raises:
            NotFound: no such map.
        """
        steps = self._http.steps.sender.call("DELETE", "maps", map_id, repeatable=False)
        return [str(version) for version in self._http.run(steps).parsed(dict)["retired"]]

    def build_details(self, build_id: str) -> Mapping[str, Any]:
        """One build with its stages, file name and note, as the service's JSON.

        Raises:
            NotFound: no such build.
        """
        return self._get("builds", build_id)

    def build_log(self, build_id: str) -> str:
        """The end of the log of a build's processes.

        Raises:
            NotFound: no such build, or no attempt at it has ended yet.
            Forbidden: the caller is no admin.
        """
        steps = self._http.steps.sender.call("GET", "builds", build_id, "log")
        return self._http.run(steps).body.decode(errors="replace")

    def _get(self, *path: str) -> Mapping[str, Any]:
        return self._http.run(self._http.steps.sender.call("GET", *path)).parsed(dict)
