"""The file of the fleets: which vehicles, in which maps, where their scans come from. YAML."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from firstfix.decode import decoder_of
from firstfix.errors import FirstfixError, InvalidOption, NotFound
from firstfix.ids import check_map_id
from firstfix.transform import Matrix, from_quaternion

from .fleet_maps import FleetMap, FleetMaps
from .scan_address import ScanAddress
from .topics import VehicleFilter

MAX_FILE_BYTES = 1 << 20
_Text = Annotated[str, Field(min_length=1, max_length=256)]
_Number = Annotated[float, Field(ge=-1e7, le=1e7, allow_inf_nan=False)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class MapEntry(_Strict):
    """A map as the vehicles name it; by default as firstfix does."""

    map_id: _Text | None = None
    versions: dict[Annotated[str, Field(pattern="^[0-9a-f]{8,64}$")], _Text] = {}
    T_vda_map: tuple[_Number, _Number, _Number] = (0.0, 0.0, 0.0)


class FleetEntry(_Strict):
    """One fleet of the file."""

    topics: _Text
    maps: Annotated[dict[str, MapEntry | None], Field(min_length=1, max_length=16)]
    scan: _Text
    media_type: _Text = "application/vnd.firstfix.scan"
    T_base_sensor: Annotated[list[float], Field(min_length=7, max_length=7)]
    max_tilt_deg: Annotated[float, Field(gt=0, le=90)] = 10.0

    @field_validator("topics")
    @classmethod
    def _are_topics(cls, value: str) -> str:
        VehicleFilter.parse(value)
        return value

    @field_validator("scan")
    @classmethod
    def _is_address(cls, value: str) -> str:
        ScanAddress(value)
        return value

    @field_validator("media_type")
    @classmethod
    def _is_known(cls, value: str) -> str:
        decoder_of(value)
        return value

    @field_validator("maps")
    @classmethod
    def _are_ids(cls, value: dict[str, MapEntry | None]) -> dict[str, MapEntry | None]:
        for map_id in value:
            check_map_id(map_id)
        return value

    @field_validator("T_base_sensor")
    @classmethod
    def _is_pose(cls, value: list[float]) -> list[float]:
        if not np.isfinite(value).all():
            raise ValueError("not finite")
        from_quaternion(value[:3], value[3:])
        return value

    @property
    def mounting(self) -> Matrix:
        """(4, 4) pose of the sensor on each vehicle."""
        return from_quaternion(self.T_base_sensor[:3], self.T_base_sensor[3:])

    @property
    def fleet_maps(self) -> FleetMaps:
        """The maps by firstfix's ids."""
        entries = {map_id: entry or MapEntry() for map_id, entry in self.maps.items()}
        return FleetMaps(
            {
                map_id: FleetMap(entry.map_id or map_id, entry.versions, entry.T_vda_map)
                for map_id, entry in entries.items()
            }
        )


class _File(_Strict):
    fleets: Annotated[dict[_Text, FleetEntry], Field(min_length=1, max_length=100)]


def read_fleets(path: Path) -> dict[str, FleetEntry]:
    """The fleets of a file by their names, in its order.

    Raises:
        NotFound: no such file.
        InvalidOption: it is not such a file.
    """
    try:
        with path.open("rb") as file:
            text = file.read(MAX_FILE_BYTES + 1)
    except OSError as error:
        raise NotFound(f"{path}: {error.strerror}") from None
    if len(text) > MAX_FILE_BYTES:
        raise InvalidOption(f"{path}: more than {MAX_FILE_BYTES} bytes")
    try:
        data: Any = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise InvalidOption(f"{path}: not YAML: {error}") from None
    try:
        return _File.model_validate(data).fleets
    except ValidationError as error:
        found = error.errors(include_url=False, include_input=False)[0]
        place = ".".join(str(part) for part in found["loc"])
        raise InvalidOption(f"{path}: {place}: {found['msg']}") from None
    except FirstfixError as error:
        raise InvalidOption(f"{path}: {error}") from None
