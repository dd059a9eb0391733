"""Settings of the service and of the build worker, from environment variables (FIRSTFIX_STORE, ...).

A figure is a setting if an operator has to choose it: where things are, who may do what, how much of a host
or a store may be taken. Any other figure is a constant beside the code that reads it.
"""

from __future__ import annotations

import hashlib
import os
import sys
from contextlib import suppress
from ipaddress import IPv4Network, IPv6Network
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, SecretStr, model_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

from firstfix.builds.limits import DEFAULT_MAX_TEMPLATES, default_build_memory_bytes
from firstfix.errors import InvalidOption
from firstfix.store.url import StoreUrl

MIB = 1 << 20
GIB = 1 << 30
NAME = "^[a-z0-9][a-z0-9_-]{0,62}$"  # of a replica
SHARED_STAGES_BYTES = 100 * GIB
STORE_DIGITS = 16  # of the digest of a store, in the name of its work folder


def _cache_home() -> Path:
    return Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser() / "firstfix"


class Settings(BaseSettings):
    """Settings of one service process. In the environment, lists are written as JSON."""

    model_config = SettingsConfigDict(env_prefix="FIRSTFIX_", frozen=True)

    # The service
    store: str = Field(description="URL of the object store: a directory, s3://, gs://, az:// or memory://")
    host: str = Field("127.0.0.1", description="address that HTTP listens on")
    port: int = Field(8080, ge=0, le=65535, description="port that HTTP listens on; 0: any free port")
    console: bool = Field(True, description="give the console's page at /console/")
    read_only: bool = Field(
        False, description="change nothing in the store: no write probe, no builds, POST /maps is refused"
    )
    replica: str | None = Field(None, pattern=NAME, description="name of this replica; default: random")
    work_dir: Path = Field(
        default_factory=lambda: _cache_home() / "work",
        description="folder of uploads in progress and of build stages; default: one for each store",
    )
    stalled_exit_s: float = Field(
        20.0, ge=0, description="time that the event loop or zenoh may stand still, then it ends; 0: never"
    )
    drain_s: float = Field(
        0.0,
        ge=0,
        le=300,
        description="time between the signal to stop, shown at /readyz, and the end of new requests",
    )
    log_level: str = Field(
        "info", pattern="^(debug|info|warning|error)$", description="lowest level of messages in the log"
    )
    log_json: bool = Field(True, description="write the log as JSON lines; false: as text for a terminal")
    verify_bytes_per_s: int = Field(
        4 * MIB,
        ge=0,
        description="maximum rate of the background verification of the store; 0: no verification",
    )

    # Limits of requests: ``limits.limits`` has them all
    workers: int = Field(
        os.cpu_count() or 1,
        ge=1,
        le=256,
        description="number of query workers: queries answered at the same time",
    )
    queue_size: int = Field(32, ge=0, description="queries that may wait; further ones get status 503")
    max_body_bytes: int = Field(
        64 * MIB, ge=1, description="maximum size of a query body, as received and without Content-Encoding"
    )
    max_inflight_bytes: int = Field(
        512 * MIB, ge=1, description="maximum size of all query bodies in memory together"
    )
    answer_timeout_s: float = Field(
        30.0, gt=0, description="time to read an answer, and 1 s for each 500 bytes up to 300 s"
    )
    max_unsent_bytes: int = Field(
        128 * MIB, ge=1, description="maximum size of the large answers that wait to be read"
    )
    localize_per_s: float | None = Field(
        None, ge=0, description="queries of one caller per second; 0: no limit; default: 50 if exposed"
    )
    build_minutes_per_day: float | None = Field(
        None,
        ge=0,
        description="minutes that one caller's builds run per day (UTC); 0: no limit of builds at all; "
        "default: 1440 if exposed",
    )
    max_upload_bytes: int = Field(
        20 * GIB,
        ge=1,
        description="maximum size of one POST /maps; open uploads of one caller have five times that",
    )

    # Maps in memory and on the disk
    cache_max_bytes: int = Field(
        8 * GIB,
        ge=1,
        description="maximum size of the versions in memory, with other memory of the query workers",
    )
    cache_dir: Path = Field(
        default_factory=lambda: _cache_home() / "versions",
        description="folder of map versions that were fetched from a remote store",
    )
    cache_max_disk_bytes: int = Field(
        64 * GIB,
        ge=0,
        description="maximum size of fetched versions on the disk; versions in use are not removed",
    )
    pinned_maps: tuple[str, ...] = Field(
        (), description="maps that are loaded at the start and never evicted"
    )
    poll_interval_s: float = Field(2.0, gt=0, description="time between checks for newly activated versions")
    holders: int = Field(
        0,
        ge=0,
        le=64,
        description="number of replicas that prefetch each map and evict it last; 0: maps are not placed",
    )
    replica_names: tuple[Annotated[str, Field(pattern=NAME)], ...] = Field(
        (), description="names of all replicas that share the maps; default: found over zenoh"
    )

    # Callers
    auth: str | None = Field(
        None,
        pattern="^(on|off)$",
        description="on: callers need a key or a token; off: they need none; default: off, on loopback only",
    )
    metrics_public: bool = Field(False, description="serve /metrics without a key")
    trusted_proxies: tuple[IPv4Network | IPv6Network, ...] = Field(
        (), description="networks of proxies whose X-Forwarded-For is trusted"
    )
    jwt_jwks: str | None = Field(
        None, description="public keys of the token issuer: an https URL or a JWKS file"
    )
    jwt_issuer: str | None = Field(None, description="required `iss` of a token")
    jwt_audience: str | None = Field(None, description="required `aud` of a token")
    jwt_scope_prefix: str = Field("", description="prefix of the scope names in a token, such as firstfix:")
    jwt_maps_claim: str | None = Field(
        None, description="claim with the patterns of map ids; default: a token is valid for every map"
    )

    # Uploads and builds
    source_urls: tuple[str, ...] = Field(
        (), description="URL prefixes, such as s3://bucket/maps/, that POST /maps may name; default: none"
    )
    run_builds: bool | None = Field(
        None, description="build maps in a process beside this one; default: true if the builder is installed"
    )
    build_queue: str = Field(
        "embedded",
        pattern=r"^(embedded|(nats|tls)://[^@\s]+)$",
        description="embedded, or the NATS server of the build workers: nats://host:4222, tls://host:4222/name",
    )
    nats_credentials: Path | None = Field(
        None, description="file with NATS credentials (user:password, a token, or a .creds file)"
    )
    nats_ca: Path | None = Field(
        None, description="PEM file of the authorities that may sign the certificate of NATS"
    )
    nats_certificate: Path | None = Field(
        None, description="PEM file with the client certificate and key for NATS"
    )
    build_command: tuple[str, ...] = Field(
        (sys.executable, "-m", "firstfix_builder.worker"),
        description="command that runs one build; options are appended",
    )
    build_ready: bool = Field(
        True,
        description="keep a process ready for the next build, which then begins sooner; "
        "none if build_command is your own",
    )
    build_sandbox: Literal["auto", "required", "off"] = Field(
        "auto", description="confine builds: auto (as far as the kernel can), required, off"
    )
    build_executor: str = Field(
        "threads",
        pattern=r"^(threads|dask(\+tls)?://[^@/\s]+:[0-9]{1,5})$",
        description="where the work of builds runs: threads of the build process, or dask://scheduler:8786",
    )
    build_lease_s: float = Field(
        30.0,
        gt=0,
        description="time without a sign of life after which a build is given to another build worker",
    )
    build_timeout_s: float = Field(
        86400.0,
        gt=0,
        description="maximum time of a build, all attempts together, and a 12th of it without progress",
    )
    build_max_memory_bytes: int = Field(
        default_factory=default_build_memory_bytes,
        ge=0,
        description="maximum memory of one build; default: half of the machine's or container's; 0: no limit",
    )
    build_max_templates: int = Field(
        DEFAULT_MAX_TEMPLATES, ge=0, description="maximum estimated number of templates of a map; 0: no limit"
    )
    shared_stages_max_bytes: int | None = Field(
        None,
        ge=0,
        description="maximum size of the finished build stages in the store; 0: none are kept there; "
        "default: 100 GiB with NATS or Dask",
    )

    # zenoh
    zenoh: bool = Field(False, description="answer over zenoh too")
    zenoh_config: Path | None = Field(
        None, description="zenoh configuration file (TLS, users, access rules); turns zenoh on"
    )
    zenoh_listen: tuple[str, ...] = Field(
        ("tcp/127.0.0.1:7447",), description="zenoh endpoints to listen on, if there is no configuration file"
    )
    zenoh_connect: tuple[str, ...] = Field(
        (), description="zenoh routers or peers to connect to, if there is no configuration file"
    )
    zenoh_trusted: bool = Field(
        False, description="accept zenoh queries without a key, because zenoh has its own access rules"
    )

    # Webhooks
    webhook_urls: Annotated[tuple[SecretStr, ...], Field(max_length=4)] = Field(
        (), description="URLs that get a signed POST for each answer of a wanted verdict"
    )
    webhook_secret_file: Path | None = Field(
        None, description="file with the secret that signs webhooks; two lines while it changes"
    )
    webhook_verdicts: tuple[Literal["localized", "ambiguous", "rejected"], ...] = Field(
        ("localized",), description="verdicts whose answers are sent"
    )

    # Recorded queries
    recorded_share: float = Field(
        0.0,
        ge=0,
        le=1,
        description="share of the queries without a pose that are recorded with their bodies; 0: none",
    )
    recorded_share_localized: float = Field(
        0.0, ge=0, le=1, description="share of the localized queries that are recorded too"
    )
    recorded_max_bytes: int = Field(
        GIB, ge=1, description="maximum size of all recorded queries; the oldest are removed"
    )
    recorded_days: float = Field(
        14.0, gt=0, le=3650, description="days after which recorded queries are removed"
    )
    recorded_store: str | None = Field(
        None,
        description="store URL or folder of recorded queries, below `recorded-queries/`; default: the store",
    )

    @model_validator(mode="before")
    @classmethod
    def _give_each_store_a_work_folder(cls, given: Any) -> Any:
        """Name the default after the store: one process at a time runs builds in a folder."""
        if isinstance(given, dict) and given.get("work_dir") is None and isinstance(given.get("store"), str):
            with suppress(InvalidOption):  # whoever opens the store tells what is wrong with its URL
                identity = StoreUrl.parse(given["store"]).identity()
                name = hashlib.sha256(identity.encode()).hexdigest()[:STORE_DIGITS]
                return {**given, "work_dir": _cache_home() / "work" / name}
        return given

    @property
    def nats_enabled(self) -> bool:
        """True if builds are given to build workers over NATS."""
        return self.build_queue != "embedded"

    @property
    def shared_stages_bytes(self) -> int:
        """Maximum size of the build stages in the store; 0 if none are kept there."""
        if self.build_executor != "threads":  # the workers of the cluster read them in the store
            return self.shared_stages_max_bytes or SHARED_STAGES_BYTES
        default = SHARED_STAGES_BYTES if self.nats_enabled else 0
        return default if self.shared_stages_max_bytes is None else self.shared_stages_max_bytes

    @property
    def zenoh_enabled(self) -> bool:
        """True if the service answers over zenoh."""
        return self.zenoh or self.zenoh_config is not None
