"""/sensors: the presets that a map can be built for."""

from __future__ import annotations

from fastapi import APIRouter

from firstfix.sensor import preset, presets

from ...schema.api_models import Sensor

router = APIRouter(tags=["maps"])


@router.get("/sensors")
async def get_sensors() -> list[Sensor]:
    """The sensor presets, by name. A build's config names one, or changes some of its values."""
    return [Sensor.model_validate(preset(name).to_mapping()) for name in presets()]
