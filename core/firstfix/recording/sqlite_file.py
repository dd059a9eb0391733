"""Reader of one sqlite3 file of a ROS 2 bag."""

from __future__ import annotations

import shutil
import sqlite3
import tempfile
from collections.abc import Iterator, Set
from contextlib import closing
from pathlib import Path

from ..errors import TooLarge
from .messages import MAX_MESSAGE_BYTES, RawMessage, Topic, ros2_type

_TOPICS = """
SELECT topics.id, name, type, serialization_format, count(messages.id)
FROM topics LEFT JOIN messages ON topics.id == messages.topic_id GROUP BY topics.id ORDER BY topics.id
"""
# Where sqlite keeps what is not yet, or should not be, in the file itself.
_BESIDE = {"-wal": "new messages", "-journal": "an unfinished change"}
_TEXT_BYTES = 1024


class SqliteFile:
    """See ``Storage``. The file is not written: one with changes beside it is copied and completed there."""

    def __init__(self, path: Path) -> None:
        self._copy: tempfile.TemporaryDirectory[str] | None = None
        self.notes: list[str] = []
        self._open = self._opened(path)
        try:
            self._open.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_MESSAGE_BYTES)
            self._topics = {
                number: Topic(_text(name), ros2_type(_text(kind)), _text(encoding), int(count))
                for number, name, kind, encoding, count in self._open.execute(_TOPICS)
            }
            self.topics = sorted(topic for topic in self._topics.values() if topic.count)
            (first,) = self._open.execute("SELECT min(timestamp) FROM messages").fetchone()
            self.start_ns = int(first or 0)
        except BaseException:
            self.close()
            raise

    def _opened(self, path: Path) -> sqlite3.Connection:
        for ending, what in _BESIDE.items():
            beside = path.with_name(path.name + ending)
            if beside.is_file() and beside.stat().st_size:
                self._copy = tempfile.TemporaryDirectory(prefix="firstfix-bag-")
                try:
                    path = _completed(path, beside, Path(self._copy.name))
                except BaseException:
                    self._copy.cleanup()
                    raise
                self.notes.append(f"{beside.name} holds {what}: a copy of {path.name} with it was read")
                break
        return sqlite3.connect(f"{path.absolute().as_uri()}?immutable=1", uri=True)

    def messages(self, topics: Set[str], start_ns: int | None) -> Iterator[RawMessage]:
        """Yield the messages of these topics in the order of recording, from a time on."""
        wanted = [number for number, topic in self._topics.items() if topic.name in topics]
        rows = self._open.execute(
            "SELECT topic_id, timestamp, data FROM messages "
            f"WHERE topic_id IN ({','.join('?' * len(wanted))}) AND timestamp >= ? ORDER BY timestamp",
            [*wanted, start_ns or 0],
        )
        for number, time_ns, body in rows:
            if not isinstance(body, bytes):  # of a number, bytes() makes as many zeros
                raise TypeError("the data of a message is no bytes")
            topic = self._topics[number]
            yield RawMessage(topic.name, int(time_ns), body, topic.type, topic.encoding)

    def close(self) -> None:
        """Close the file, and remove its copy."""
        self._open.close()
        if self._copy is not None:
            self._copy.cleanup()


def _completed(path: Path, beside: Path, folder: Path) -> Path:
    """A copy with the changes that stand beside the file, as its recorder would have put them in."""
    size, free = path.stat().st_size + beside.stat().st_size, shutil.disk_usage(folder).free
    if size > free // 2:
        raise TooLarge(
            f"{beside.name} holds {_BESIDE[beside.name.removeprefix(path.name)]}, and a copy of {size} bytes "
            f"would take over half of the free space in {folder.parent}: name another folder in TMPDIR, or "
            f"let sqlite complete the file itself: `sqlite3 {path.name} 'PRAGMA wal_checkpoint(TRUNCATE)'`"
        )
    for one in (path, beside):
        shutil.copyfile(one, folder / one.name)
    with closing(sqlite3.connect(folder / path.name)) as opened:
        opened.execute("PRAGMA journal_mode = DELETE").fetchall()
        opened.execute("SELECT count(*) FROM sqlite_master").fetchall()
    return folder / path.name


def _text(value: object) -> str:
    if not isinstance(value, str) or len(value) > _TEXT_BYTES:
        raise TypeError("a name of a topic is no text, or too long")
    return value
