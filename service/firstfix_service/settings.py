"""Settings of the service, from environment variables (FIRSTFIX_STORE, FIRSTFIX_PORT, ...) or by name."""

from __future__ import annotations

import os
import sys
from ipaddress import IPv4Network, IPv6Network
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict

from firstfix.builds.limits import DEFAULT_MAX_TEMPLATES, default_build_memory_bytes

MIB = 1 << 20
GIB = 1 << 30
NAME = "^[a-z0-9][a-z0-9_-]{0,62}$"  # of a replica


def _cache_home() -> Path:
    return Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser() / "firstfix"


class Settings(BaseSettings):
    """Settings of one service process. In the environment, lists are written as JSON."""

    model_config = SettingsConfigDict(env_prefix="FIRSTFIX_", frozen=True)

    store: str = Field(description="URL of the object store: a directory, s3://, gs://, az:// or memory://")
    host: str = Field("127.0.0.1", description="address that HTTP listens on")
    port: int = Field(8080, ge=0, le=65535, description="port that HTTP listens on; 0: any free port")
    log_level: str = Field(
        "info", pattern="^(debug|info|warning|error)$", description="lowest level of messages in the log"
    )
    log_json: bool = Field(True, description="write the log as JSON lines; false: as text for a terminal")

    console: bool = Field(True, description="give the console's page at /console/")

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

    pinned_maps: tuple[str, ...] = Field(
        (), description="maps that are loaded at the start and never evicted"
    )
    cache_max_disk_bytes: int = Field(
        64 * GIB,
        ge=0,
        description="maximum size of fetched versions on the disk; versions in use are not removed",
    )

    cache_dir: Path = Field(
        default_factory=lambda: _cache_home() / "versions",
        description="folder of map versions that were fetched from a remote store",
    )
    cache_max_bytes: int = Field(
        8 * GIB,
        ge=1,
        description="maximum size of the versions in memory, with other memory of the query workers",
    )
    poll_interval_s: float = Field(2.0, gt=0, description="time between checks for newly activated versions")

    work_dir: Path = Field(
        default_factory=lambda: _cache_home() / "work",
        description="folder of uploads in progress and of build stages",
    )
    max_upload_bytes: int = Field(20 * GIB, ge=1, description="maximum size of one POST /maps")
    source_urls: tuple[str, ...] = Field(
        (), description="URL prefixes, such as s3://bucket/maps/, that POST /maps may name; default: none"
    )
    run_builds: bool | None = Field(
        None, description="build maps in a process beside this one; default: true if the builder is installed"
    )
    build_command: tuple[str, ...] = Field(
        (sys.executable, "-m", "firstfix_builder.worker"),
        description="command that runs one build; options are appended",
    )
    build_niceness: int = Field(
        10,
        ge=0,
        le=19,
        description="niceness of build processes; a higher value leaves more processor time to queries",
    )

    build_queue: str = Field(
        "embedded",
        pattern=r"^(embedded|(nats|tls)://[^@\s]+)$",
        description="embedded, or the NATS server of the build workers: nats://host:4222, tls://host:4222/name",
    )
    build_attempts: int = Field(
        3, ge=1, description="attempts of a build that may die in the same stage before the build fails"
    )
    build_lease_s: float = Field(
        30.0,
        gt=0,
        description="time without a sign of life after which a build is given to another build worker",
    )
    build_timeout_s: float = Field(
        86400.0, gt=0, description="maximum time of a build, all attempts together; then it fails"
    )
    build_stall_s: float = Field(7200.0, gt=0, description="maximum time of a build without progress")
    build_max_memory_bytes: int = Field(
        default_factory=default_build_memory_bytes,
        ge=0,
        description="maximum memory of one build; default: half of the machine's or container's; 0: no limit",
    )
    build_max_templates: int = Field(
        DEFAULT_MAX_TEMPLATES, ge=0, description="maximum estimated number of templates of a map; 0: no limit"
    )
    build_sandbox: Literal["auto", "required", "off"] = Field(
        "auto", description="confine builds: auto (as far as the kernel can), required, off"
    )
    provisional_versions: bool = Field(
        True,
        description="publish a coarse version first for a map without one; a build's config can forbid it",
    )
    share_stages: bool | None = Field(
        None, description="keep finished build stages in the store; default: true with NATS"
    )
    shared_stages_days: float = Field(
        7.0, gt=0, description="days that finished stages are kept in the store"
    )
    shared_stages_max_bytes: int = Field(
        100 * GIB, ge=1, description="maximum size of all finished stages in the store"
    )
    build_executor: str = Field(
        "threads",
        pattern=r"^(threads|dask(\+tls)?://[^@/\s]+:[0-9]{1,5})$",
        description="where the work of builds runs: threads of the build process, or dask://scheduler:8786",
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

    verify_bytes_per_s: int = Field(
        4 * MIB,
        ge=0,
        description="maximum rate of the background verification of the store; 0: no verification",
    )

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
    replica: str | None = Field(None, pattern=NAME, description="name of this replica; default: random")

    holders: int = Field(
        0,
        ge=0,
        le=64,
        description="number of replicas that prefetch each map and evict it last; 0: maps are not placed",
    )
    replica_names: tuple[Annotated[str, Field(pattern=NAME)], ...] = Field(
        (), description="names of all replicas that share the maps; default: found over zenoh"
    )

    samples_share: float = Field(
        0.0,
        ge=0,
        le=1,
        description="share of the queries without a pose that are kept with their bodies; 0: none",
    )
    samples_share_localized: float = Field(
        0.0,
        ge=0,
        le=1,
        description="share of the localized queries below `samples_below_probability` that are kept too",
    )
    samples_below_probability: float = Field(
        1.0, ge=0, le=1, description="localized queries with at least this probability are never kept"
    )
    samples_per_minute: int = Field(
        10, ge=1, le=6000, description="maximum number of queries that this process keeps per minute"
    )
    samples_max_body_bytes: int = Field(
        8 * MIB,
        ge=1,
        description="maximum size of a kept query body; queries with larger bodies are not kept",
    )
    samples_max_bytes: int = Field(
        GIB, ge=1, description="maximum size of all kept queries; the oldest are removed"
    )
    samples_days: float = Field(14.0, gt=0, le=3650, description="days after which kept queries are removed")
    samples_store: str | None = Field(
        None, description="store URL or folder of the kept queries, below `samples/`; default: the store"
    )

    sightings: bool = Field(
        True, description="count where localized queries contradict their map, for GET /maps/{map_id}/changes"
    )
    sightings_share: float = Field(
        1.0, ge=0, le=1, description="share of the localized queries that are counted, by chance"
    )
    sightings_flush_s: float = Field(
        300.0, gt=0, description="time between puts of this replica's counts to the store"
    )

    auth: str | None = Field(
        None,
        pattern="^(on|off)$",
        description="on: callers need a key or a token; off: they need none; default: off, on loopback only",
    )
    keys_refresh_s: float = Field(5.0, gt=0, description="time between checks for new and revoked API keys")
    keys_max_age_s: float = Field(
        3600.0, gt=0, description="time that known API keys stay valid while the store cannot be read"
    )
    jwt_jwks: str | None = Field(
        None, description="public keys of the token issuer: an https URL or a JWKS file"
    )
    jwt_issuer: str | None = Field(None, description="required `iss` of a token")
    jwt_audience: str | None = Field(None, description="required `aud` of a token")
    jwt_algorithms: tuple[Literal["RS256", "RS384", "RS512", "ES256", "ES384", "EdDSA"], ...] = Field(
        ("RS256", "ES256", "EdDSA"), min_length=1, description="accepted signature algorithms of tokens"
    )
    jwt_leeway_s: float = Field(
        30.0, ge=0, le=600, description="accepted clock difference to the token issuer"
    )
    jwt_scope_prefix: str = Field("", description="prefix of the scope names in a token, such as firstfix:")
    jwt_maps_claim: str | None = Field(
        None, description="claim with the patterns of map ids; default: a token is valid for every map"
    )
    metrics_public: bool = Field(False, description="serve /metrics without a key")
    zenoh_trusted: bool = Field(
        False, description="accept zenoh queries without a key, because zenoh has its own access rules"
    )
    trusted_proxies: tuple[IPv4Network | IPv6Network, ...] = Field(
        (), description="networks of proxies whose X-Forwarded-For is trusted"
    )
    localize_per_s: float | None = Field(
        None, ge=0, description="queries of one caller per second; 0: no limit; default: 50 if exposed"
    )
    builds_per_hour: float | None = Field(
        None,
        ge=0,
        description="maps that one caller may submit per hour; 0: no limit; default: 60 if exposed",
    )
    changes_per_min: float | None = Field(
        None,
        ge=0,
        description="changes of one map by one caller per minute; 0: no limit; default: 60 if exposed",
    )
    max_builds_per_caller: int | None = Field(
        None,
        ge=0,
        description="builds of one caller that may wait or run; 0: no limit; default: 50 if exposed",
    )
    build_minutes_per_day: float | None = Field(
        None,
        ge=0,
        description="build minutes of one caller per day (UTC); 0: no limit; default: 1440 if exposed",
    )
    auth_failures_per_min: float = Field(
        60.0,
        ge=0,
        description="invalid credentials from one address per minute, then it gets status 429; 0: no limit",
    )
    strangers_per_s: float = Field(
        50.0, ge=0, description="requests from one address without a caller, then answers wait; 0: no limit"
    )

    read_only: bool = Field(
        False, description="change nothing in the store: no write probe, no builds, POST /maps is refused"
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

    @property
    def nats_enabled(self) -> bool:
        """True if builds are given to build workers over NATS."""
        return self.build_queue != "embedded"

    @property
    def stages_are_shared(self) -> bool:
        """True if build stages are kept in the store."""
        if self.build_executor != "threads":  # the workers of the cluster read them in the store
            return True
        return self.nats_enabled if self.share_stages is None else self.share_stages

    @property
    def sightings_counted_share(self) -> float:
        """Share of the localized queries whose sightings are counted: 0 if none can be stored."""
        return self.sightings_share if self.sightings and not self.read_only else 0.0

    @property
    def zenoh_enabled(self) -> bool:
        """True if the service answers over zenoh."""
        return self.zenoh or self.zenoh_config is not None
