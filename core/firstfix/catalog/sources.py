"""Sources: files that builds read, kept in the store under their content's sha256.

maps/<map_id>/sources/<sha256>               a source, for all builds that name it
maps/<map_id>/sources/<sha256>.<build_id>    a copy for one build, made while a collection removed the first
"""

from __future__ import annotations

from pathlib import Path

from ..ids import check_build_id, check_map_id, check_version
from ..store.sha256 import sha256_of
from ..store.store import Store


def source_key(map_id: str, sha256: str, build_id: str = "") -> str:
    """Key of a source, or of one build's own copy of it.

    Raises:
        InvalidOption: one of the ids is invalid.
    """
    own = f".{check_build_id(build_id)}" if build_id else ""
    return f"maps/{check_map_id(map_id)}/sources/{check_version(sha256)}{own}"


def sha256_of_source(key: str) -> str:
    """SHA-256 in a source's key, with or without a build id."""
    return key.rsplit("/", 1)[-1].split(".")[0]


def put_source(store: Store, map_id: str, path: Path, *, build_id: str = "") -> str:
    """Put a file as a source, or with a build id as that build's own copy. Returns its sha256.

    Raises:
        InvalidOption: one of the ids is invalid.
        StoreError: the store failed.
    """
    sha256 = sha256_of(path)
    store.put_file(source_key(map_id, sha256, build_id), path)
    return sha256
