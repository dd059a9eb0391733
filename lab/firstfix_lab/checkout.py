"""Checkout that the lab measures: it runs from there, and is of no use elsewhere."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "lab" / "results"
BENCH = ROOT / "build" / "bench"
