"""MCAP files with channels of any encoding, by the package mcap, which our own reader is held against."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from mcap.writer import CompressionType, Writer

Message = tuple[str, str, str, bytes, int, bytes]


def write_mcap(
    path: Path,
    messages: Iterable[Message],
    *,
    profile: str = "ros2",
    compression: CompressionType = CompressionType.ZSTD,
    **options: Any,
) -> Path:
    """Writes a file.

    Args:
        messages: topic, schema's name, encoding (``cdr``, ``ros1``, ``json``, ``protobuf``), schema, time in
            ns and bytes of each.
        options: of the writer.

    Returns:
        The path.
    """
    languages = {"cdr": "ros2msg", "ros1": "ros1msg", "json": "jsonschema", "protobuf": "protobuf"}
    channels: dict[tuple[str, str, str], int] = {}
    with path.open("wb") as file:
        writer = Writer(file, compression=compression, **options)
        writer.start(profile)
        for topic, name, encoding, schema, time_ns, body in messages:
            key = (topic, name, encoding)
            if key not in channels:
                number = writer.register_schema(name, languages.get(encoding, encoding), schema)
                channels[key] = writer.register_channel(topic, encoding, number)
            writer.add_message(channels[key], time_ns, body, time_ns)
        writer.finish()
    return path
