"""The field of a cloud that has the times of its points, or looks like it."""

from __future__ import annotations

from dataclasses import dataclass

_SHOWN = 60  # characters of a name: those of strangers may be long


@dataclass(frozen=True)
class TimeField:
    """A field by its name, its numbers, and what they were taken for.

    Attributes:
        name: of the field; two names with a plus between them: seconds and nanoseconds.
        type: of its numbers, as ``uint32``.
        first, last: the least and the greatest number of a point that is a return.
        unit: s, ms, us or ns; None: the field was not understood.
        clock: what the numbers count from. ``stamp``: the cloud's stamp; ``epoch``: the epoch, by the stamp's
            clock; ``own``: anything else, so that times count from the first point; None: not understood.
        why: the reason why it was not understood.
    """

    name: str
    type: str
    first: float
    last: float
    unit: str | None = None
    clock: str | None = None
    why: str = ""

    @property
    def is_filling(self) -> bool:
        """Whether it is all zeros: drivers fill them in where they know no times."""
        return self.first == self.last == 0

    @property
    def described(self) -> str:
        """The field in words: its name, type, range and unit."""
        range_ = f"{self.first:.15g} to {self.last:.15g}"
        return f"{self.name[:_SHOWN]} ({self.type}, {range_}{f' {self.unit}' if self.unit else ''})"
