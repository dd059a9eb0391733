"""Units and the coordinate system that a LAS or LAZ file tells: GeoTIFF keys, or well-known text (WKT).

LAS 1.4 R15, 2.6 (records of LASF_Projection); GeoTIFF 1.1, 7.1; OGC 01-009 and 18-010r11 (WKT 1 and 2).
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from .las_header import LasHeader

_USER = b"LASF_Projection"
_GEO_KEYS, _GEO_DOUBLES, _GEO_TEXT, _WKT = 34735, 34736, 34737, 2112
_MODEL, _CITATION, _PROJECTED_SYSTEM = 1024, 1026, 3072
_LINEAR, _LINEAR_METRES, _VERTICAL = 3076, 3077, 4099
_GEOGRAPHIC, _USER_DEFINED = 2, 32767
_MAX_RECORD_BYTES = 65_535
_METRE, _DEGREE = "metre", "degree"
US_SURVEY_FOOT_M = 1200 / 3937
# Units of length by their EPSG codes.
_UNITS = {
    9001: (_METRE, 1.0),
    9002: ("international foot", 0.3048),
    9003: ("US survey foot", US_SURVEY_FOOT_M),
    9005: ("Clarke's foot", 0.3047972654),
    9036: ("kilometre", 1000.0),
}
_TOKEN = re.compile(r'"(?:[^"]|"")*"|[\[\](),]|[^\[\](),"\s]+')


@dataclass(frozen=True)
class Unit:
    """A unit of length, or the degree, which has no length.

    Attributes:
        metres: in one unit; None: it is the degree.
    """

    name: str
    metres: float | None


@dataclass(frozen=True)
class LasUnits:
    """Units and frame of a file's coordinates; None and empty text where it tells nothing.

    Attributes:
        across: of x and y.
        up: of z.
        system: name of the coordinate system.
    """

    across: Unit | None = None
    up: Unit | None = None
    system: str = ""


@dataclass(frozen=True)
class _Node:
    """``KEYWORD[...]`` of WKT."""

    keyword: str
    parts: list[_Node | str]

    @property
    def nodes(self) -> list[_Node]:
        return [part for part in self.parts if isinstance(part, _Node)]

    @property
    def name(self) -> str:
        first = self.parts[0] if self.parts else ""
        return first.strip('"') if isinstance(first, str) else ""


def las_units(path: Path, header: LasHeader) -> LasUnits:
    """Units of a file by its records. Damaged records tell nothing.

    Args:
        header: of the file, which has been checked.
    """
    records: dict[int, bytes] = {}
    with path.open("rb") as file:
        for record in header.records:
            if record.user == _USER and record.size <= _MAX_RECORD_BYTES:
                file.seek(record.place)
                records.setdefault(record.kind, file.read(record.size))
    by_text = _from_wkt(records.get(_WKT, b""))
    by_keys = _from_keys(records)
    first, second = (by_text, by_keys) if header.has_wkt or by_keys.across is None else (by_keys, by_text)
    return first if first.across is not None else second


def _from_keys(records: Mapping[int, bytes]) -> LasUnits:
    keys = dict(_geo_keys(records.get(_GEO_KEYS, b"")))
    text = records.get(_GEO_TEXT, b"").decode("latin-1")
    doubles = records.get(_GEO_DOUBLES, b"")
    _, length, start = keys.get(_CITATION, (0, 0, 0))
    system = text[start : start + length].strip("|\0 ")[:200]
    _, _, code = keys.get(_PROJECTED_SYSTEM, (0, 0, 0))
    if code not in (0, _USER_DEFINED):
        system = f"{system} (EPSG {code})".strip()
    if keys.get(_MODEL, (0, 0, 0))[2] == _GEOGRAPHIC:
        return LasUnits(Unit(_DEGREE, None), _unit_of_code(keys.get(_VERTICAL)), system)
    across = _unit_of_code(keys.get(_LINEAR))
    place, _, at = keys.get(_LINEAR_METRES, (0, 0, 0))
    if place == _GEO_DOUBLES and 8 * at + 8 <= len(doubles):
        across = across or _unit("its own unit", struct.unpack_from("<d", doubles, 8 * at)[0])
    return LasUnits(across, _unit_of_code(keys.get(_VERTICAL)), system)


def _geo_keys(raw: bytes) -> Iterator[tuple[int, tuple[int, int, int]]]:
    """Yield each key with its record, length and value or place (GeoTIFF's SHORTs)."""
    for at in range(8, len(raw) - 7, 8):
        key, *entry = struct.unpack_from("<4H", raw, at)
        yield key, (entry[0], entry[1], entry[2])


def _unit_of_code(entry: tuple[int, int, int] | None) -> Unit | None:
    known = None if entry is None or entry[0] else _UNITS.get(entry[2])
    return None if known is None else Unit(*known)


def _unit(name: str, metres: float) -> Unit | None:
    """The unit; None if its length is none. Rounded lengths of known units are made exact."""
    if not 1e-4 < metres < 1e5:  # NaN compares false
        return None
    known = next((one for one in _UNITS.values() if abs(metres / one[1] - 1) < 1e-7), None)
    return Unit(*known) if known is not None else Unit(name[:60], metres)


def _from_wkt(raw: bytes) -> LasUnits:
    root = _tree(raw.decode("utf-8", "replace").strip("\0 \r\n"))
    if root is None:
        return LasUnits()
    projected = _first(root, ("PROJCS", "PROJCRS", "PROJECTEDCRS", "LOCAL_CS", "ENGCRS"))
    vertical = _first(root, ("VERT_CS", "VERTCRS", "VERTICALCRS"))
    up = None if vertical is None else _unit_of(vertical)
    code = next((node.parts[-1] for node in root.nodes if node.keyword in ("AUTHORITY", "ID")), "")
    number = code.strip('"') if isinstance(code, str) else ""
    system = f"{root.name[:160]} (EPSG {number[:10]})" if number.isdigit() else root.name[:160]
    if projected is not None:
        axes = [node for node in projected.nodes if node.keyword == "AXIS"]
        return LasUnits(_unit_of(projected), up or (_unit_of(axes[2]) if len(axes) == 3 else None), system)
    if _first(root, ("GEOGCS", "GEOGCRS", "GEODCRS", "GEOGRAPHICCRS")) is not None:
        return LasUnits(Unit(_DEGREE, None), up, system)
    return LasUnits(None, up, system)


def _unit_of(node: _Node) -> Unit | None:
    """Unit of a coordinate system: its own, or that of its first axis."""
    for one in node.nodes:
        if one.keyword in ("UNIT", "LENGTHUNIT") and len(one.parts) > 1 and isinstance(one.parts[1], str):
            try:
                return _unit(one.name, float(one.parts[1]))
            except ValueError:
                return None
    axis = next((one for one in node.nodes if one.keyword == "AXIS"), None)
    return None if axis is None else _unit_of(axis)


def _first(root: _Node, keywords: tuple[str, ...]) -> _Node | None:
    """The outermost node of these keywords."""
    level = [root]
    while level:
        found = next((node for node in level if node.keyword in keywords), None)
        if found is not None:
            return found
        level = [child for node in level for child in node.nodes]
    return None


def _tree(text: str) -> _Node | None:
    """The tree of a WKT; None if it is none."""
    top = _Node("", [])
    open_nodes, word = [top], ""
    for token in _TOKEN.findall(text):
        if token in "[(":
            node = _Node(word.upper(), [])
            if open_nodes[-1].parts and open_nodes[-1].parts[-1] == word:
                open_nodes[-1].parts[-1] = node
            open_nodes.append(node)
        elif token in "])":
            if len(open_nodes) == 1:
                return None
            open_nodes.pop()
        elif token != ",":
            open_nodes[-1].parts.append(token)
        word = token
    return top.nodes[0] if len(open_nodes) == 1 and top.nodes else None
