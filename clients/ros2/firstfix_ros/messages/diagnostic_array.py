"""Encoder of diagnostic_msgs/DiagnosticArray."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from firstfix.ros.cdr import CdrWriter
from firstfix.ros.header import Header, write_header

TYPE = "diagnostic_msgs/msg/DiagnosticArray"
OK, WARN, ERROR = range(3)  # of diagnostic_msgs/DiagnosticStatus


@dataclass(frozen=True)
class Diagnosis:
    """Fields of a diagnostic_msgs/DiagnosticStatus."""

    level: int
    name: str
    message: str
    hardware_id: str = ""
    values: Mapping[str, str] = field(default_factory=dict)


def encode_diagnostic_array(header: Header, diagnoses: list[Diagnosis]) -> bytes:
    """Encode diagnoses as little-endian CDR."""
    writer = CdrWriter()
    write_header(writer, header)
    writer.numbers("I", [len(diagnoses)])
    for one in diagnoses:
        writer.numbers("B", [one.level])
        for text in (one.name, one.message, one.hardware_id):
            writer.text(text)
        writer.numbers("I", [len(one.values)])
        for key, value in one.values.items():
            writer.text(key)
            writer.text(value)
    return writer.bytes()
