"""Every failure of a reader as one clear error that names the file and the reason."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from firstfix.errors import FirstfixError, InputError, MalformedData, NotFound, TooLarge


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Put the file's name before the reason of an InputError; no such file becomes NotFound.

    The name without its folders: they are the machine's business, not the uploader's.
    """
    try:
        yield
    except InputError as error:
        raise type(error)(f"{path.name}: {error}") from error
    except FileNotFoundError as error:
        raise NotFound(f"{path.name}: no such file") from error
    except MemoryError as error:
        raise TooLarge(f"{path.name}: it does not fit in memory") from error
    except OSError as error:
        raise MalformedData(f"{path.name}: it cannot be read: {error.strerror or error}") from error


@contextmanager
def foreign(format_name: str, path: Path) -> Iterator[None]:
    """Around a library's reader: whatever it raises on damaged data becomes MalformedData."""
    try:
        yield
    except (FirstfixError, MemoryError, OSError):
        raise
    except Exception as error:
        reason = str(error).replace(f"{path.parent}/", "") or type(error).__name__
        reason = " ".join(reason.split())[:300]
        raise MalformedData(f"{format_name}: {reason}") from error
