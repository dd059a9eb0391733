"""The errors of firstfix: one tree, each leaf with a stable code that crosses the wire.

    FirstfixError
    |- InputError                 the caller sent something that cannot be used
    |  |- InvalidScan             wrong shape, too few or too many points
    |  |- InvalidOption           an option or a config value is out of its range
    |  |- UnsupportedFormat       no reader for this media type or file ending
    |  |- MalformedData           the bytes contradict their own format
    |  |- TooLarge                over a byte, point or expansion limit
    |  |- ChecksumMismatch        the bytes are not those that their sender hashed
    |  |- NotAcceptable           the answer has no form that the caller takes
    |  |- PreconditionFailed      the caller speaks another version of a protocol
    |  `- DescriptorMismatch      the query was described otherwise than the map
    |- NotFound                   no such map, version or build
    |- Conflict                   it exists already, or its state forbids this
    |- ReadOnly                   this service or store was told to change nothing
    |  `- IdempotencyConflict     the key was used for another request
    |- StoreError                 the object store failed
    |  |- StoreUnavailable        it does not answer
    |  |- StoreUnsafe             it lets a create-only put overwrite
    |  |- UnreadableRecord        one record in it is damaged: all others are as they were
    |  `- OutOfSpace              there is no room for it
    |- VersionError               a published version cannot be served
    |  |- CorruptVersion          a file is missing or its sha256 differs
    |  `- IncompatibleVersion     made by a format this reader does not know
    |- BuildError                 a build ended without a version
    |  |- BuildFailed             a stage could not do its work
    |  |- BuildAttemptsExceeded   its worker died time after time
    |  |- BuildTimedOut           it took longer than it may
    |  |- BuildStalled            it made no progress for too long
    |  |- ClusterUnavailable      the machines that build are out of reach: try again
    |  `- BuildCancelled          somebody asked for it
    |- Unauthorized               no credential, or none that is worth anything
    |- Forbidden                  the credential does not allow this
    |- RateLimited                too many requests of one caller: try again later
    |- QuotaExceeded              one caller has as much as one caller may have
    |- Overloaded                 the queue is full: try again later
    |- WorkerLost                 the process that worked on it died: try again
    `- DeadlineExceeded           the answer would have come too late

The code, not the class name, is the protocol: clients match on it, so it never changes.
"""

from __future__ import annotations


class FirstfixError(Exception):
    """Base of every error that firstfix raises on purpose."""

    code = "internal"


class InputError(FirstfixError):
    code = "invalid_input"


class InvalidScan(InputError):
    code = "invalid_scan"


class InvalidOption(InputError):
    code = "invalid_option"


class UnsupportedFormat(InputError):
    code = "unsupported_format"


class MalformedData(InputError):
    code = "malformed_data"


class TooLarge(InputError):
    code = "too_large"


class ChecksumMismatch(InputError):
    code = "checksum_mismatch"


class NotAcceptable(InputError):
    code = "not_acceptable"


class PreconditionFailed(InputError):
    code = "precondition_failed"


class DescriptorMismatch(InputError):
    code = "descriptor_mismatch"


class NotFound(FirstfixError):
    code = "not_found"


class Conflict(FirstfixError):
    code = "conflict"


class ReadOnly(FirstfixError):
    code = "read_only"


class IdempotencyConflict(Conflict):
    code = "idempotency_conflict"


class StoreError(FirstfixError):
    code = "store_error"


class StoreUnavailable(StoreError):
    code = "store_unavailable"


class StoreUnsafe(StoreError):
    code = "store_unsafe"


class UnreadableRecord(StoreError):
    """
    Attributes:
        kind: of the record (``firstfix.store.json_record.RecordKind``).
        key: of the record in the store.
    """

    code = "unreadable_record"

    def __init__(self, message: str, kind: str = "", key: str = "") -> None:
        super().__init__(message)
        self.kind, self.key = kind, key


class OutOfSpace(StoreError):
    code = "out_of_space"


class VersionError(FirstfixError):
    code = "version_error"


class CorruptVersion(VersionError):
    code = "corrupt_version"


class IncompatibleVersion(VersionError):
    code = "incompatible_version"


class BuildError(FirstfixError):
    code = "build_error"


class BuildFailed(BuildError):
    code = "build_failed"


class BuildAttemptsExceeded(BuildError):
    code = "build_attempts_exceeded"


class BuildTimedOut(BuildError):
    code = "build_timed_out"


class BuildStalled(BuildError):
    code = "build_stalled"


class ClusterUnavailable(BuildError):
    code = "cluster_unavailable"


class BuildCancelled(BuildError):
    code = "build_cancelled"


class Unauthorized(FirstfixError):
    code = "unauthorized"


class Forbidden(FirstfixError):
    code = "forbidden"


class RateLimited(FirstfixError):
    """
    Attributes:
        retry_after_s: seconds until another request is let through.
    """

    code = "rate_limited"

    def __init__(self, message: str, retry_after_s: float = 1.0) -> None:
        super().__init__(message)
        self.retry_after_s = retry_after_s


class QuotaExceeded(FirstfixError):
    """
    Attributes:
        retry_after_s: when waiting should have helped; None: the caller has to give something up first.
    """

    code = "quota_exceeded"

    def __init__(self, message: str, *, retry_after_s: float | None = None) -> None:
        super().__init__(message)
        self.retry_after_s = retry_after_s


class Overloaded(FirstfixError):
    """Attributes:
    retry_after_s: when there should be room, as far as that can be told.
    """

    code = "overloaded"

    def __init__(self, message: str = "", *, retry_after_s: float = 1.0) -> None:
        super().__init__(message)
        self.retry_after_s = retry_after_s


class WorkerLost(FirstfixError):
    code = "worker_lost"


class DeadlineExceeded(FirstfixError):
    code = "deadline_exceeded"


def all_errors() -> list[type[FirstfixError]]:
    """Every class of the tree, base first: what a table of statuses has to cover."""
    found: list[type[FirstfixError]] = [FirstfixError]
    for cls in found:
        found.extend(cls.__subclasses__())
    return found
