"""Everything an operator can set, from the environment (FIRSTFIX_STORE, FIRSTFIX_PORT, ...) or by name."""

from __future__ import annotations

import os
import sys
from ipaddress import IPv4Network, IPv6Network
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict

MIB = 1 << 20
GIB = 1 << 30
NAME = "^[a-z0-9][a-z0-9_-]{0,62}$"  # of a replica


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
    max_decoded_bytes: int = Field(64 * MIB, ge=1, description="of a query's body without Content-Encoding")
    max_inflight_bytes: int = Field(512 * MIB, ge=1, description="of all query bodies held at the same time")
    body_timeout_s: float = Field(
        30.0, gt=0, description="for a query's body to arrive; for the next piece of a file"
    )

    max_connections: int | None = Field(
        None, ge=1, description="HTTP connections; default: as the limit of open files allows, up to 4096"
    )
    max_connections_per_address: int = Field(
        256, ge=0, description="HTTP connections of one address, and at most half of all; 0: any number"
    )
    head_timeout_s: float = Field(20.0, gt=0, description="for the head of a request to arrive")
    keep_alive_s: float = Field(30.0, gt=0, description="that a connection is kept for the next request")
    answer_timeout_s: float = Field(
        30.0, gt=0, description="for an answer to be taken in, and a second for each 500 bytes"
    )

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

    build_queue: str = Field(
        "embedded",
        pattern=r"^(embedded|(nats|tls)://[^@\s]+)$",
        description="embedded, or the NATS server whose workers build: nats://host:4222, tls://host:4222/name",
    )
    build_attempts: int = Field(3, ge=1, description="of a build whose worker dies in the same stage")
    build_lease_s: float = Field(
        30.0, gt=0, description="without a sign of life from a worker until its build is another's"
    )
    build_timeout_s: float = Field(
        86400.0, gt=0, description="that a build may run, all its attempts together, or it fails"
    )
    build_stall_s: float = Field(
        7200.0, gt=0, description="that a build may run without any progress, or it fails"
    )
    build_max_memory_bytes: int | None = Field(
        None, ge=1, description="of one build's processes: a build that takes more fails; default: no limit"
    )
    build_sandbox: Literal["auto", "required", "off"] = Field(
        "auto", description="confine builds: as far as the kernel can; required: or none is run; off"
    )
    share_stages: bool | None = Field(
        None, description="keep builds' finished stages in the store for other workers; default: with NATS"
    )
    shared_stages_days: float = Field(7.0, gt=0, description="that finished stages are kept in the store")
    shared_stages_max_bytes: int = Field(100 * GIB, ge=1, description="of all finished stages in the store")
    build_executor: str = Field(
        "threads",
        pattern=r"^(threads|dask(\+tls)?://[^@/\s]+:[0-9]{1,5})$",
        description="who does builds' work: threads of their process, or a cluster at dask://scheduler:8786",
    )
    nats_credentials: Path | None = Field(
        None, description="file for NATS: user:password, a token, or a .creds file"
    )
    nats_ca: Path | None = Field(None, description="PEM file of the authorities that NATS may be signed by")
    nats_certificate: Path | None = Field(
        None, description="PEM file of certificate and key that this process shows to NATS"
    )

    max_open_uploads: int = Field(
        256, ge=0, description="begun at /uploads and not yet removed, in the store"
    )
    max_open_uploads_per_caller: int = Field(32, ge=1, description="the same, of one caller")
    max_upload_bytes_per_caller: int = Field(
        100 * GIB, ge=1, description="of the open uploads of one caller together, as announced"
    )
    max_upload_streams: int = Field(
        16,
        ge=1,
        description="uploads and forms that this process takes at the same time, 32 MiB of memory each",
    )
    max_upload_streams_per_caller: int = Field(4, ge=1, description="the same, of one caller")
    upload_min_bytes_per_s: int = Field(
        1024, ge=0, description="mean rate of a file's body over `body_timeout_s`, or it is given up"
    )
    upload_timeout_s: float = Field(
        6 * 3600.0, gt=0, description="for one request that brings a file; a large file can come in several"
    )
    min_free_bytes: int = Field(
        GIB, ge=0, description="left free by uploads on the disks of the work directory and of a file store"
    )
    max_event_streams: int = Field(128, ge=0, description="streams of build events at the same time")
    max_event_streams_per_caller: int = Field(16, ge=1, description="the same, of one caller")
    verify_bytes_per_s: int = Field(
        4 * MIB, ge=0, description="read from the store in the background to find damage; 0: none"
    )
    verify_days: float = Field(
        30.0, ge=1, le=3650, description="after which a file that was found right is read once more"
    )
    georeference_ttl_s: float = Field(
        5.0, ge=0, description="within which a changed georeference counts on every replica"
    )

    zenoh: bool = Field(False, description="answer over zenoh too")
    zenoh_config: Path | None = Field(None, description="zenoh config file (TLS, users, ACL); implies zenoh")
    zenoh_listen: tuple[str, ...] = Field(
        ("tcp/127.0.0.1:7447",), description="zenoh endpoints to listen on, without a config file"
    )
    zenoh_connect: tuple[str, ...] = Field(
        (), description="zenoh routers or peers to connect to, without a config file"
    )
    zenoh_max_message_bytes: int = Field(
        96 * MIB, ge=1, description="of one zenoh message; a longer one is dropped unseen, without an answer"
    )
    replica: str | None = Field(None, pattern=NAME, description="name of this replica; default: a random one")

    holders: int = Field(
        0,
        ge=0,
        le=64,
        description="replicas that hold each map, loaded ahead; 0: nobody in particular",
    )
    replica_names: tuple[Annotated[str, Field(pattern=NAME)], ...] = Field(
        (), description="all replicas that share the maps; default: those that zenoh shows"
    )

    samples_share: float = Field(
        0.0, ge=0, le=1, description="of the queries that were not localized, kept with their bodies; 0: none"
    )
    samples_share_localized: float = Field(
        0.0,
        ge=0,
        le=1,
        description="of the localized queries below `samples_below_probability`, kept as well",
    )
    samples_below_probability: float = Field(
        1.0, ge=0, le=1, description="localized queries that are as probable are never kept"
    )
    samples_per_minute: int = Field(10, ge=1, le=6000, description="queries kept at most by this process")
    samples_max_body_bytes: int = Field(8 * MIB, ge=1, description="queries with larger bodies are not kept")
    samples_max_bytes: int = Field(GIB, ge=1, description="of all kept queries; the oldest go")
    samples_days: float = Field(14.0, gt=0, le=3650, description="after which kept queries are removed")
    samples_store: str | None = Field(
        None, description="store URL or directory for kept queries, below `samples/`; default: the store"
    )

    auth: str | None = Field(
        None,
        pattern="^(on|off)$",
        description="on: callers need a key or token; off: nobody is asked; unset: off, only on loopback",
    )
    keys_refresh_s: float = Field(5.0, gt=0, description="between looks for new and revoked API keys")
    keys_max_age_s: float = Field(
        3600.0, gt=0, description="known API keys go on working while the store cannot be read"
    )
    jwt_jwks: str | None = Field(None, description="keys of the tokens' issuer: an https URL, or a JWKS file")
    jwt_issuer: str | None = Field(None, description="`iss` of a token")
    jwt_audience: str | None = Field(None, description="`aud` of a token, or one of them")
    jwt_algorithms: tuple[Literal["RS256", "RS384", "RS512", "ES256", "ES384", "EdDSA"], ...] = Field(
        ("RS256", "ES256", "EdDSA"), min_length=1, description="signatures of tokens that are accepted"
    )
    jwt_leeway_s: float = Field(30.0, ge=0, le=600, description="how far the issuer's clock may be off")
    jwt_scope_prefix: str = Field("", description="before the names of scopes in a token, such as firstfix:")
    jwt_maps_claim: str | None = Field(
        None, description="claim with the patterns of map ids; none: a token is for every map"
    )
    metrics_public: bool = Field(False, description="/metrics needs no key")
    zenoh_trusted: bool = Field(
        False, description="zenoh queries need no key: zenoh's own access rules are enough"
    )
    trusted_proxies: tuple[IPv4Network | IPv6Network, ...] = Field(
        (), description="networks of proxies whose X-Forwarded-For is believed"
    )
    localize_per_s: float | None = Field(
        None, ge=0, description="queries of one caller; 0: any number; default: 50, on loopback any number"
    )
    builds_per_hour: float | None = Field(
        None, ge=0, description="maps that one caller hands in; 0 and default as above, 60"
    )
    changes_per_min: float | None = Field(
        None,
        ge=0,
        description="activations, rollbacks and so on of one map by one caller; 0 and default as above, 60",
    )
    max_builds_per_caller: int | None = Field(
        None, ge=0, description="builds of one caller that wait or run; 0 and default as above, 50"
    )
    build_minutes_per_day: float | None = Field(
        None,
        ge=0,
        description="that one caller's builds run (UTC day); 0 and default as above, 1440",
    )
    auth_failures_per_min: float = Field(
        60.0, ge=0, description="of one address until it is answered 429; 0: any number"
    )

    read_only: bool = Field(
        False, description="change nothing in the store: no write probe, no builds, POST /maps is refused"
    )

    drain_s: float = Field(
        0.0,
        ge=0,
        le=300,
        description="between the sign to stop, seen at /readyz, and taking no more requests",
    )

    @property
    def nats_enabled(self) -> bool:
        return self.build_queue != "embedded"

    @property
    def stages_are_shared(self) -> bool:
        if self.build_executor != "threads":  # its workers read them there
            return True
        return self.nats_enabled if self.share_stages is None else self.share_stages

    @property
    def zenoh_enabled(self) -> bool:
        return self.zenoh or self.zenoh_config is not None
