"""Indices whose templates are found in Python, so that a test may look at or change what is found."""

from dataclasses import fields, replace

from firstfix.engine.index import MapIndex
from firstfix.engine.retrieval.cascade import Cascade


class PythonCascade(Cascade):
    """A cascade that is searched in Python."""

    compiled = None  # type: ignore[assignment]


def searched_by(index: MapIndex, kind: type[PythonCascade] = PythonCascade) -> MapIndex:
    """The index with a cascade of another kind."""
    return replace(index, cascade=kind(*(getattr(index.cascade, one.name) for one in fields(Cascade))))
