"""Lines of a log for people: those in JSON are made plain."""

from __future__ import annotations

import json
from collections.abc import Iterator


def plain_lines(text: str) -> Iterator[str]:
    """Yield the lines of a log; of one in JSON its time, level, event and the rest."""
    for line in text.splitlines():
        try:
            said = json.loads(line)
        except ValueError:
            said = None
        if not isinstance(said, dict) or "event" not in said:
            yield line
            continue
        time, level, event = (str(said.pop(name, "")) for name in ("timestamp", "level", "event"))
        trace = said.pop("exception", None)
        rest = "".join(f" {name}={value}" for name, value in said.items() if name != "logger")
        yield f"{time} {level:<8} {event}{rest}"
        if trace:
            yield from str(trace).splitlines()
