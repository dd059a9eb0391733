"""The names of the data sets, for the command line."""

from __future__ import annotations

from enum import Enum


class Dataset(str, Enum):
    """A public data set, or any recording with the poses of its sensor."""

    nclt = "nclt"
    mulran = "mulran"
    helipr = "helipr"
    hilti = "hilti"
    newer_college = "newer_college"
    recording = "recording"
