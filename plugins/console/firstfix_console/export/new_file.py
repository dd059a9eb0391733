"""A file that appears when it is whole."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from firstfix.errors import Conflict, InvalidOption


@contextmanager
def new_file(path: Path, *, force: bool) -> Iterator[Path]:
    """Give a folder beside ``path``, for a file ``out`` in it, which takes the path's name at the end.

    Nothing is left of a file that was not finished.

    Args:
        force: replace a file that is there.

    Raises:
        Conflict: there is such a file, and ``force`` is not set.
        InvalidOption: the path is a folder, or its folder cannot be written to.
    """
    if path.is_dir():
        raise InvalidOption(f"{path} is a folder")
    _check_free(path, force)
    try:
        folder = Path(tempfile.mkdtemp(prefix=f".{path.name}-", dir=path.parent))
    except OSError as error:
        raise InvalidOption(f"{path.parent}: {error.strerror}") from None
    try:
        yield folder
        if force:
            (folder / "out").replace(path)
        else:
            _put_new(folder / "out", path)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _put_new(written: Path, path: Path) -> None:
    try:
        path.hardlink_to(written)  # unlike a renaming, it never replaces a file
    except FileExistsError:
        _check_free(path, force=False)
    except OSError:  # a file system without links
        _check_free(path, force=False)
        written.replace(path)


def _check_free(path: Path, force: bool) -> None:
    if path.exists() and not force:
        raise Conflict(f"{path} is there already: --force replaces it")
