"""What a build can be told: one small model a stage, all with working defaults."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Literal

import yaml
from pydantic import Field, ValidationError, field_validator

from firstfix.engine_config import (
    ClusterConfig,
    DescriptorConfig,
    PreprocessConfig,
    RegistrationConfig,
    SearchConfig,
    Stage,
    VerificationConfig,
)
from firstfix.errors import InvalidOption
from firstfix.sensor import SensorModel, preset

from .clean_cloud import CleanConfig
from .learn_keys import LearnKeysConfig
from .reconstruct_mesh import ReconstructConfig
from .self_test import SelfTestConfig
from .templates import SimulateConfig
from .viewpoints import ViewpointConfig


class EngineOverrides(Stage):
    """Parts of the engine's config to set by hand; what is None follows from the map and the sensor.

    Attributes:
        method: "default", or the paper's: PCA-SC, clusters, CNZ keys in hash tables and KD trees.
        cluster: None with the default method: every template stands for itself.
    """

    method: Literal["default", "paper"] = "default"
    descriptor: DescriptorConfig | None = None
    preprocess: PreprocessConfig | None = None
    cluster: ClusterConfig | None = None
    search: SearchConfig | None = None
    registration: RegistrationConfig | None = None
    verification: VerificationConfig | None = None


class BuildConfig(Stage):
    """The whole of a build's config: with the source, all that decides the version's digest.

    Attributes:
        sensor: a preset's name, or a mapping as in a sensor YAML.
        level: turn the index so that z is up, where the map leans.
    """

    sensor: str | dict[str, Any] = "os1-64"
    axis: Literal["z-up", "y-up"] = "z-up"
    level: bool = True
    clean: CleanConfig = CleanConfig()
    reconstruct: ReconstructConfig = ReconstructConfig()
    viewpoints: ViewpointConfig = ViewpointConfig()
    simulate: SimulateConfig = SimulateConfig()
    engine: EngineOverrides = EngineOverrides()
    learn_keys: LearnKeysConfig = LearnKeysConfig()
    self_test: SelfTestConfig = Field(default_factory=SelfTestConfig)

    @field_validator("sensor")
    @classmethod
    def _known_sensor(cls, value: str | dict[str, Any]) -> str | dict[str, Any]:
        _sensor(value)
        return value

    @property
    def sensor_model(self) -> SensorModel:
        return _sensor(self.sensor)

    @classmethod
    def parse(cls, data: Any) -> BuildConfig:
        """From JSON-like data.

        Raises:
            InvalidOption: an unknown key or a value out of range; says which and why.
        """
        try:
            return cls.model_validate(data)
        except ValidationError as error:
            problems = "; ".join(
                f"{'.'.join(str(part) for part in problem['loc'])}: {problem['msg']}"
                for problem in error.errors()
            )
            raise InvalidOption(f"build config: {problems}") from None

    @classmethod
    def from_file(cls, path: Path) -> BuildConfig:
        """From a YAML or JSON file."""
        try:
            return cls.parse(yaml.safe_load(path.read_text()) or {})
        except (yaml.YAMLError, UnicodeDecodeError) as error:
            raise InvalidOption(f"{path}: {error}") from None

    def to_mapping(self) -> dict[str, Any]:
        return json.loads(self.model_dump_json())


def _sensor(value: str | dict[str, Any]) -> SensorModel:
    try:
        return preset(value) if isinstance(value, str) else SensorModel.from_mapping(value)
    except InvalidOption as error:
        raise ValueError(str(error)) from None
