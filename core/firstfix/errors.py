"""The errors of firstfix: a tree of classes, each with a stable code that is sent to clients.

    FirstfixError
    |- InputError                 the caller sent unusable input
    |  |- InvalidScan             wrong shape, too few or too many points
    |  |- InvalidOption           an option or a config value is out of its range
    |  |- UnsupportedFormat       no reader for this media type or file ending
    |  |- MalformedData           the bytes contradict their own format
    |  |- UnfitMap                a map of which no version can be made: its findings say why
    |  |- TooLarge                over a byte, point or expansion limit
    |  |- ChecksumMismatch        the bytes differ from those that the sender hashed
    |  |- NotAcceptable           no form of the answer is acceptable to the caller
    |  |- PreconditionFailed      the caller speaks another version of a protocol
    |  `- DescriptorMismatch      the query has other descriptor parameters than the map
    |- NotFound                   no such map, version or build
    |  `- NoSuchFile              no such file on this machine; also a FileNotFoundError
    |- Conflict                   it already exists, or its state forbids this
    |  `- IdempotencyConflict     the key was used for another request
    |- ReadOnly                   this service or store is read-only
    |- StoreError                 the object store failed
    |  |- StoreUnavailable        it does not answer
    |  |- StoreUnsafe             it lets a create-only put overwrite
    |  |- UnreadableRecord        one record is damaged; the others are not affected
    |  `- OutOfSpace              the store, or the disk for work, is full
    |- VersionError               a published version cannot be served
    |  |- CorruptVersion          a file is missing or its sha256 differs
    |  `- IncompatibleVersion     made by a format this reader does not know
    |- BuildError                 a build ended without a version
    |  |- BuildFailed             a stage could not do its work
    |  |  `- NothingToPatch       no change of the map is confirmed
    |  |- BuildAttemptsExceeded   its worker died too often
    |  |- BuildTimedOut           it took too long
    |  |- BuildStalled            it made no progress for too long
    |  |- ClusterUnavailable      the build machines cannot be reached: try again
    |  `- BuildCancelled          it was cancelled
    |- Unauthorized               missing or invalid credential
    |  `- ClockSkew               the caller's clock is wrong: ask again by the service's
    |- Forbidden                  the credential does not allow this
    |- RateLimited                too many requests of one caller: try again later
    |- QuotaExceeded              the caller has reached a limit
    |- Overloaded                 the queue is full: try again later
    |- WorkerLost                 the process that worked on it died: try again
    |- DeadlineExceeded           the answer would be too late
    `- QueryCancelled             nobody waits for the answer any more

Clients match on the code, so it never changes. The name of a class may change.
"""

from __future__ import annotations

REBUILD = "build the map again with `firstfix maps rebuild MAP`, or submit it again (POST /maps)"


def pip_install(*requirements: str) -> str:
    """Remedy: what to install."""
    return f"pip install {' or '.join(map(repr, requirements))} in the checkout"


class FirstfixError(Exception):
    """Base of every error that firstfix raises on purpose."""

    code = "internal"


class InputError(FirstfixError):
    """The caller sent unusable input."""

    code = "invalid_input"


class InvalidScan(InputError):
    """Wrong shape, too few or too many points."""

    code = "invalid_scan"


class InvalidOption(InputError):
    """An option or a config value is out of its range."""

    code = "invalid_option"


class UnsupportedFormat(InputError):
    """No reader for this media type or file ending."""

    code = "unsupported_format"


class MalformedData(InputError):
    """The bytes contradict their own format."""

    code = "malformed_data"


class UnfitMap(InputError):
    """A map of which no version can be made: its findings say why."""

    code = "unfit_map"


class TooLarge(InputError):
    """Over a byte, point or expansion limit."""

    code = "too_large"


class ChecksumMismatch(InputError):
    """The bytes differ from those that the sender hashed."""

    code = "checksum_mismatch"


class NotAcceptable(InputError):
    """No form of the answer is acceptable to the caller."""

    code = "not_acceptable"


class PreconditionFailed(InputError):
    """The caller speaks another version of a protocol."""

    code = "precondition_failed"


class DescriptorMismatch(InputError):
    """The query has other descriptor parameters than the map."""

    code = "descriptor_mismatch"


class NotFound(FirstfixError):
    """No such map, version or build.

    Attributes:
        map_id: the map that there is not; empty: something else is not there.
        nearest: the map that its name most resembles; empty: none does, or nobody has looked.
    """

    code = "not_found"

    def __init__(self, message: str, *, map_id: str = "", nearest: str = "") -> None:
        super().__init__(f"{message}: did you mean {nearest}?" if nearest else message)
        self.map_id, self.nearest = map_id, nearest

    @classmethod
    def of_map(cls, map_id: str, nearest: str = "") -> NotFound:
        """There is no map of this name."""
        return cls(f"no map {map_id}", map_id=map_id, nearest=nearest)


class NoSuchFile(NotFound, FileNotFoundError):
    """No such file on this machine; also a FileNotFoundError."""

    code = "no_such_file"


class Conflict(FirstfixError):
    """The thing already exists, or its state forbids this."""

    code = "conflict"


class ReadOnly(FirstfixError):
    """This service or store is read-only."""

    code = "read_only"


class IdempotencyConflict(Conflict):
    """The key was used for another request."""

    code = "idempotency_conflict"


class StoreError(FirstfixError):
    """The object store failed."""

    code = "store_error"


class StoreUnavailable(StoreError):
    """The store does not answer."""

    code = "store_unavailable"


class StoreUnsafe(StoreError):
    """The store lets a create-only put overwrite an object."""

    code = "store_unsafe"


class UnreadableRecord(StoreError):
    """One record is damaged; the others are not affected.

    Attributes:
        kind: kind of the record (``firstfix.store.json_record.RecordKind``).
        key: key of the record in the store.
    """

    code = "unreadable_record"

    def __init__(self, message: str, kind: str = "", key: str = "") -> None:
        super().__init__(message)
        self.kind, self.key = kind, key


class OutOfSpace(StoreError):
    """The store is full."""

    code = "out_of_space"


class VersionError(FirstfixError):
    """A published version cannot be served."""

    code = "version_error"


class CorruptVersion(VersionError):
    """A file is missing or its sha256 differs."""

    code = "corrupt_version"


class IncompatibleVersion(VersionError):
    """Made by a format this reader does not know, or for another ranking."""

    code = "incompatible_version"


class BuildError(FirstfixError):
    """A build ended without a version."""

    code = "build_error"


class BuildFailed(BuildError):
    """A stage could not do its work."""

    code = "build_failed"


class NothingToPatch(BuildFailed):
    """No change of the map is confirmed: it stays as it is."""

    code = "nothing_to_patch"


class BuildAttemptsExceeded(BuildError):
    """Its worker died too often."""

    code = "build_attempts_exceeded"


class BuildTimedOut(BuildError):
    """The build took too long."""

    code = "build_timed_out"


class BuildStalled(BuildError):
    """The build made no progress for too long."""

    code = "build_stalled"


class ClusterUnavailable(BuildError):
    """The build machines cannot be reached: try again."""

    code = "cluster_unavailable"


class BuildCancelled(BuildError):
    """The build was cancelled."""

    code = "build_cancelled"


class Unauthorized(FirstfixError):
    """Missing or invalid credential."""

    code = "unauthorized"


class ClockSkew(Unauthorized):
    """The caller's clock is wrong: ask again by the service's.

    Attributes:
        time_ms: of the service's clock, since 1970 (UTC).
    """

    code = "clock_skew"

    def __init__(self, message: str, time_ms: int = 0) -> None:
        super().__init__(message)
        self.time_ms = time_ms


class Forbidden(FirstfixError):
    """The credential does not allow this."""

    code = "forbidden"


class RateLimited(FirstfixError):
    """Too many requests of one caller: try again later.

    Attributes:
        retry_after_s: seconds until another request is accepted.
    """

    code = "rate_limited"

    def __init__(self, message: str, retry_after_s: float = 1.0) -> None:
        super().__init__(message)
        self.retry_after_s = retry_after_s


class QuotaExceeded(FirstfixError):
    """The caller has reached a limit.

    Attributes:
        retry_after_s: seconds until a retry may succeed; None: the caller has to free something first.
    """

    code = "quota_exceeded"

    def __init__(self, message: str, *, retry_after_s: float | None = None) -> None:
        super().__init__(message)
        self.retry_after_s = retry_after_s


class Overloaded(FirstfixError):
    """The queue is full: try again later.

    Attributes:
        retry_after_s: estimated seconds until the queue has room.
    """

    code = "overloaded"

    def __init__(self, message: str = "", *, retry_after_s: float = 1.0) -> None:
        super().__init__(message)
        self.retry_after_s = retry_after_s


class WorkerLost(FirstfixError):
    """The process that worked on it died: try again."""

    code = "worker_lost"


class DeadlineExceeded(FirstfixError):
    """The answer would be too late."""

    code = "deadline_exceeded"


class QueryCancelled(FirstfixError):
    """Nobody waits for the answer any more."""

    code = "query_cancelled"


def all_errors() -> list[type[FirstfixError]]:
    """Every class of the tree, base classes first."""
    found: list[type[FirstfixError]] = [FirstfixError]
    for cls in found:
        found.extend(cls.__subclasses__())
    return found


_BY_CODE = {cls.code: cls for cls in all_errors()}


def error_class(code: str) -> type[FirstfixError]:
    """The class with the code. A code that is not known here has the base class."""
    return _BY_CODE.get(code, FirstfixError)
