"""Everything an operator can set, from the environment (FIRSTFIX_STORE, FIRSTFIX_PORT, ...) or by name."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict

MIB = 1 << 20
GIB = 1 << 30


def _cache_home() -> Path:
    return Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser() / "firstfix"


class Settings(BaseSettings):
    """Settings of one service process. Lists are JSON in the environment."""

    model_config = SettingsConfigDict(env_prefix="FIRSTFIX_", frozen=True)

    store: str = Field(description="URL of the object store: a directory, s3://, gs://, az:// or memory://")
    host: str = Field("127.0.0.1", description="address that HTTP listens on")
    port: int = Field(8080, ge=0, le=65535, description="port that HTTP listens on; 0: any free one")
    log_level: str = Field("info", pattern="^(debug|info|warning|error)$", description="lowest level logged")
    log_json: bool = Field(True, description="logs as JSON lines; false: for eyes")

    workers: int = Field(os.cpu_count() or 1, ge=1, le=256, description="queries answered at the same time")
    queue_size: int = Field(32, ge=0, description="queries that may wait; more are answered 503")
    max_body_bytes: int = Field(64 * MIB, ge=1, description="of a query's body as it arrives")
    max_decoded_bytes: int = Field(256 * MIB, ge=1, description="of a query's body without Content-Encoding")
    max_inflight_bytes: int = Field(512 * MIB, ge=1, description="of all query bodies held at the same time")
    body_timeout_s: float = Field(30.0, gt=0, description="for a query's body to arrive")

    worker_processes: bool = Field(
        True, description="answer queries in processes of their own; false: in threads of this one"
    )
    query_timeout_s: float = Field(
        30.0, gt=0, description="for a query to run, then it is given up and its worker process replaced"
    )
    pinned_maps: tuple[str, ...] = Field((), description="maps loaded at the start and never put out")
    cache_max_disk_bytes: int = Field(
        64 * GIB, ge=0, description="of fetched versions on the disk; those in use stay beyond it"
    )
    sweep_interval_s: float = Field(
        60.0, gt=0, description="until every map's log was read again, in case a notice of a change was lost"
    )

    cache_dir: Path = Field(
        default_factory=lambda: _cache_home() / "versions",
        description="map versions fetched from a store that is no directory",
    )
    cache_max_versions: int = Field(16, ge=1, description="map versions kept loaded")
    cache_max_bytes: int = Field(
        8 * GIB,
        ge=1,
        description="of the versions kept loaded: their files, and what the workers hold besides",
    )
    poll_interval_s: float = Field(2.0, gt=0, description="between looks for newly activated versions")

    work_dir: Path = Field(
        default_factory=lambda: _cache_home() / "work", description="uploads on their way, and builds' stages"
    )
    max_upload_bytes: int = Field(20 * GIB, ge=1, description="of one POST /maps")
    source_urls: tuple[str, ...] = Field(
        (), description="URL prefixes, such as s3://bucket/maps/, that POST /maps may name; none by default"
    )
    run_builds: bool | None = Field(
        None, description="build maps in a process beside this one; default: if the builder is installed"
    )
    build_command: tuple[str, ...] = Field(
        (sys.executable, "-m", "firstfix_builder.worker"), description="runs one build; options are appended"
    )
    build_niceness: int = Field(10, ge=0, le=19, description="how far builds stand back behind queries")

    zenoh: bool = Field(False, description="answer over zenoh too")
    zenoh_config: Path | None = Field(None, description="zenoh config file (TLS, users, ACL); implies zenoh")
    zenoh_listen: tuple[str, ...] = Field(
        ("tcp/127.0.0.1:7447",), description="zenoh endpoints to listen on, without a config file"
    )
    zenoh_connect: tuple[str, ...] = Field(
        (), description="zenoh routers or peers to connect to, without a config file"
    )
    zenoh_max_message_bytes: int = Field(64 * MIB, ge=1, description="of one zenoh message")
    replica: str | None = Field(
        None, pattern="^[a-z0-9][a-z0-9_-]{0,62}$", description="name of this replica; default: a random one"
    )

    @property
    def zenoh_enabled(self) -> bool:
        return self.zenoh or self.zenoh_config is not None
