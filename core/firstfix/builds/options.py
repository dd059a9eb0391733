"""Interface of the process that runs one build: its options, the stages that it reports, and its exit codes.

The service appends ``BuildOptions.arguments()`` to ``FIRSTFIX_BUILD_COMMAND`` and adds ``environment()``.
That command may be an operator's own program.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from pathlib import Path
from urllib.parse import urlsplit

from ..errors import InvalidOption
from .limits import DEFAULT_MAX_TEMPLATES

DEFAULT_MAX_SOURCE_BYTES = 32 << 30
THREADS = "threads"
WHEN_TOLD = "-"  # in place of a build's id
_DASK_SCHEMES = {"dask": "tcp", "dask+tls": "tls"}

FETCH_SOURCE, PROVISIONAL, PUBLISH = "fetch_source", "provisional", "publish"
# The stages that make a version, in order.
STAGES = (
    "read_map",
    "reconstruct_mesh",
    "sample_viewpoints",
    "fit_engine",
    "make_templates",
    "cluster",
    "learn_keys",
    "carve_free_space",
    "build_index",
    "draw_cloud",
    "self_test",
)


def reported_stages(stages: Sequence[str] = STAGES, *, provisional: bool = True) -> tuple[str, ...]:
    """All stages that a build reports, in order. Those of a provisional version count as one."""
    return (FETCH_SOURCE, *stages[:1], *([PROVISIONAL] if provisional else []), *stages[1:], PUBLISH)


class ExitCode(IntEnum):
    """Exit code of ``python -m firstfix_builder.worker``; the last ones have the numbers of sysexits.h."""

    SUCCEEDED = 0
    FAILED = 1  # the status has the reason
    USAGE = 2
    CANCELLED = 3
    NO_SPACE = 73  # the store or the work folder is full: run it again a few times
    TRY_AGAIN = 75  # it was stopped, or the store or the cluster is out of reach: run it again


@dataclass(frozen=True, kw_only=True)
class BuildOptions:
    """Options of the run of one build. They do not change the version, other than ``BuildConfig``.

    Attributes:
        build_id: the build on record; empty if none is; ``WHEN_TOLD``: the first line of standard input.
        store: URL of the store of maps and builds.
        work: folder of sources and stages.
        executor: threads, dask://HOST:PORT, or dask+tls://HOST:PORT with Dask's own certificates.
        sandbox: auto: as far as the kernel supports it; required: refuse to build without it; off.
        max_memory_bytes: of all processes of the build together; None: no limit.
        max_templates: a map of more, by estimate, is refused before the work is begun; None: no limit.
        max_source_bytes: largest size of one source file.
        recorded_store: URL of the store of recorded queries, which patches read; empty: ``store``.
        source_urls: prefixes of http and https URLs that are fetched; none by default, as a worker that
            fetches anything is a way into the network behind it.
        source_roots: folders that ``file://`` URLs may point into; requests come over the network, so none by
            default.
        share_stages: fetch finished stages from the store, and put them there.
        provisional: publish a provisional version first, if the config wants it and the map has no full one.
        tied_to_stdin: stop as on SIGTERM when standard input ends: the parent was killed.
        log_level, log_json: of the build's log.
        traceparent: of the trace whose ids are in the log of the sandbox.
    """

    build_id: str = ""
    store: str = ""
    work: Path = Path()
    executor: str = THREADS
    sandbox: str = "auto"
    max_memory_bytes: int | None = None
    max_templates: int | None = DEFAULT_MAX_TEMPLATES
    max_source_bytes: int = DEFAULT_MAX_SOURCE_BYTES
    recorded_store: str = ""
    source_urls: tuple[str, ...] = ()
    source_roots: tuple[Path, ...] = ()
    share_stages: bool = False
    provisional: bool = True
    tied_to_stdin: bool = False
    log_level: str = "info"
    log_json: bool = False
    traceparent: str | None = None

    def arguments(self) -> list[str]:
        """Command line of the build, without what ``environment`` says."""
        most = str(self.max_source_bytes)
        return [
            *(part for url in self.source_urls for part in ("--source-url", url)),
            *(part for root in self.source_roots for part in ("--source-root", str(root))),
            *(["--executor", self.executor] if self.executor != THREADS else []),
            *([] if self.provisional else ["--no-provisional"]),
            *("--store", self.store, "--build", self.build_id, "--work", str(self.work)),
            *(["--tied-to-stdin"] if self.tied_to_stdin else []),
            *(["--share-stages"] if self.share_stages else []),
            *(["--max-source-bytes", most] if most != str(DEFAULT_MAX_SOURCE_BYTES) else []),
        ]

    def environment(self) -> dict[str, str]:
        """Variables of the build, with the names of the service's own settings."""
        traceparent = {"TRACEPARENT": self.traceparent} if self.traceparent else {}
        recorded_queries = {"FIRSTFIX_RECORDED_STORE": self.recorded_store} if self.recorded_store else {}
        return (
            traceparent
            | recorded_queries
            | {
                "FIRSTFIX_LOG_LEVEL": self.log_level,
                "FIRSTFIX_LOG_JSON": str(self.log_json).lower(),
                "FIRSTFIX_BUILD_SANDBOX": self.sandbox,
                "FIRSTFIX_BUILD_MAX_MEMORY_BYTES": str(self.max_memory_bytes or 0),
                "FIRSTFIX_BUILD_MAX_TEMPLATES": str(self.max_templates or 0),
            }
        )

    @classmethod
    def from_arguments(
        cls, arguments: Sequence[str] | None = None, environment: Mapping[str, str] = os.environ
    ) -> BuildOptions:
        """Read what ``arguments`` and ``environment`` wrote. A wrong command line ends the process.

        Args:
            arguments: None: those of this process.
        """
        parser = argparse.ArgumentParser(
            prog="firstfix_builder.worker",
            description="Runs one build.",
            argument_default=argparse.SUPPRESS,  # the defaults are those of the fields
        )
        add = parser.add_argument
        roots = "allow file:// sources below this folder; may be repeated"
        urls = "allow http or https sources below this URL; may be repeated"
        shared = "fetch finished stages from the store, and put them there"
        early = "publish no provisional version, whatever the build's config says"
        told_id = "the build to run; -: wait for its id, the first line of standard input"
        modes = "auto: as far as the kernel supports it; required: refuse to build without it"
        add("--store", required=True, metavar="URL", help="the store of maps and builds")
        add("--build", required=True, dest="build_id", metavar="ID", help=told_id)
        add("--work", required=True, type=Path, metavar="DIR", help="sources and stage cache")
        add("--max-source-bytes", type=int, metavar="N", help="largest size of one source file")
        add("--source-root", dest="source_roots", action="append", type=Path, metavar="DIR", help=roots)
        add("--source-url", dest="source_urls", action="append", metavar="PREFIX", help=urls)
        add("--share-stages", action="store_true", help=shared)
        add("--no-provisional", dest="provisional", action="store_false", help=early)
        add("--tied-to-stdin", action="store_true", help="stop as on SIGTERM when standard input ends")
        add("--executor", metavar="URL", help="threads, dask://HOST:PORT or dask+tls://HOST:PORT")
        add("--sandbox", choices=("auto", "required", "off"), help=modes)
        chosen = vars(parser.parse_args(arguments))
        for name in ("source_roots", "source_urls"):
            chosen[name] = tuple(chosen.get(name, ()))
        most = environment.get("FIRSTFIX_BUILD_MAX_TEMPLATES", DEFAULT_MAX_TEMPLATES)
        told = {
            "sandbox": environment.get("FIRSTFIX_BUILD_SANDBOX", "auto"),
            "max_memory_bytes": int(environment.get("FIRSTFIX_BUILD_MAX_MEMORY_BYTES", 0)) or None,
            "max_templates": int(most) or None,
            "recorded_store": environment.get("FIRSTFIX_RECORDED_STORE", ""),
            "log_level": environment.get("FIRSTFIX_LOG_LEVEL", "info"),
            "log_json": environment.get("FIRSTFIX_LOG_JSON") == "true",
            "traceparent": environment.get("TRACEPARENT"),
        }
        return cls(**{**told, **chosen})

    def inside(self, *, provisional: bool, traceparent: str | None) -> BuildOptions:
        """The options of the sandbox, which may have neither the store nor the network.

        Args:
            provisional: this build publishes a provisional version.
        """
        return replace(
            self,
            store="",
            recorded_store="",
            executor=THREADS,
            work=self.work / "build",
            source_urls=(),
            source_roots=(),
            tied_to_stdin=False,
            provisional=provisional,
            traceparent=traceparent,
        )

    @property
    def scheduler(self) -> str | None:
        """Address of the scheduler in the form of Dask, such as tcp://scheduler:8786; None for threads.

        Raises:
            InvalidOption: the executor is neither, or an address is incomplete.
        """
        if self.executor == THREADS:
            return None
        parts = urlsplit(self.executor)
        if parts.scheme not in _DASK_SCHEMES:
            raise InvalidOption(
                f"no executor {self.executor!r}: it is {THREADS}, dask://HOST:PORT or dask+tls://HOST:PORT"
            )
        try:
            port = parts.port
        except ValueError:
            port = None
        if not parts.hostname or port is None or not 1 <= port <= 65535:
            raise InvalidOption(
                f"{self.executor!r} names no scheduler: {parts.scheme}://HOST:PORT, such as :8786"
            )
        if parts.username is not None or parts.path not in ("", "/") or parts.query or parts.fragment:
            raise InvalidOption(f"an executor is {parts.scheme}://HOST:PORT, without user, path or query")
        host = f"[{parts.hostname}]" if ":" in parts.hostname else parts.hostname
        return f"{_DASK_SCHEMES[parts.scheme]}://{host}:{port}"
