"""What a build can be told: one small model a stage, all with working defaults.

It stands in the core so that a service checks a config before anything is built, without the builder.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Literal

import yaml
from pydantic import Field, ValidationError, field_validator

from ..engine.config import (
    ClusterConfig,
    DescriptorConfig,
    PreprocessConfig,
    RegistrationConfig,
    SearchConfig,
    Stage,
    VerificationConfig,
)
from ..errors import InvalidOption
from ..sensor import SensorModel, preset


class CleanConfig(Stage):
    """Attributes:
    voxel_m: points of one voxel become their mean; None keeps every point.
    max_points: the voxel grows until the cloud is below this: what bounds the time of a build.
    radius_spacings: the neighbourhood of a point, in point spacings.
    min_neighbours: a point with fewer neighbours there is a stray; 0 keeps all.
    """

    voxel_m: float | None = Field(0.08, gt=0, le=10)
    max_points: int = Field(4_000_000, ge=1_000)
    radius_spacings: float = Field(4.0, gt=0, le=100)
    min_neighbours: int = Field(3, ge=0, le=100)


class ReconstructConfig(Stage):
    """Lengths follow the spacing of the points on the surface, unless given.

    Attributes:
        cell_m: edge of the finest Poisson cell; None: cell_spacings point spacings.
        cell_spacings: see cell_m.
        trim_spacings: surface further than this from every point is cut away.
        normal_spacings, normal_neighbours: a normal is taken from at most so many points so near.
        point_weight: how hard the surface is pulled to the points; the less, the smoother.
        tile_cells: edge of a tile in cells; its square bounds memory.
        margin_cells: what a tile looks at around its square, so that neighbours agree where they meet.
    """

    cell_m: float | None = Field(None, gt=0, le=10)
    cell_spacings: float = Field(1.2, gt=0, le=20)
    trim_spacings: float = Field(2.0, gt=0, le=100)
    normal_spacings: float = Field(4.0, gt=1, le=100)
    normal_neighbours: int = Field(20, ge=3, le=200)
    point_weight: float = Field(1.0, ge=0, le=100)
    tile_cells: int = Field(384, ge=32, le=4096)
    margin_cells: int = Field(12, ge=2, le=256)


class ViewpointConfig(Stage):
    """Attributes:
    spacing_m: one viewpoint a square of this edge; None: a metre, or what ``fit_spacing`` finds better.
    mount_height_m: of the sensor over the floor; "auto": the trajectory's where there is one, else
        the sensor model's.
    max_slope_deg, step_height_m: what the robot climbs. Reconstructed floors are bumpy: be generous.
    robot_height_m: free height that it needs; at least the sensor has to fit below.
    footprint_radius_m: free width to every side of it.
    bridge_gap_m: holes in the floor up to this wide do not stop it.
    max_distance_to_trajectory_m: no viewpoint further from the trajectory; None: no limit.
    tile_m: edge of the square tiles that templates are made and stored in, one after the other.
    """

    spacing_m: float | None = Field(None, ge=0.1, le=100)
    mount_height_m: float | Literal["auto"] = "auto"
    max_slope_deg: float = Field(20.0, ge=0, le=60)
    step_height_m: float = Field(0.25, ge=0, le=2)
    robot_height_m: float = Field(1.0, gt=0, le=10)
    footprint_radius_m: float = Field(0.3, gt=0, le=10)
    bridge_gap_m: float = Field(1.2, ge=0, le=10)
    max_distance_to_trajectory_m: float | None = Field(None, gt=0)
    tile_m: float = Field(128.0, ge=4, le=10_000)


class SimulateConfig(Stage):
    """How finely templates are cast: the descriptor's cells are coarser than most sensors' rays."""

    max_rays: int = Field(16_384, ge=500, le=1_000_000)


class PerturbConfig(Stage):
    """Standard deviations and means of what goes wrong in a scan."""

    noise_m: float = Field(0.02, ge=0, le=1)
    dropout: float = Field(0.1, ge=0, lt=1)
    occluders: float = Field(6.0, ge=0, le=100, description="passers-by, on average")
    strangers: float = Field(3.0, ge=0, le=100, description="car-sized things that the map lacks, on average")
    height_m: float = Field(0.05, ge=0, le=1)
    tilt_deg: float = Field(2.0, ge=0, le=45)


class LearnKeysConfig(Stage):
    """Attributes:
    scans: simulated to learn from; 0: keys stay as the descriptor makes them.
    numbers: of a projected key.
    shrinkage: how little the directions of the perturbations are believed. With little of it a key
        finds more of the scans it was taught, and less of another scanner's or of a half hidden one's.
    """

    scans: int = Field(1500, ge=0, le=100_000)
    numbers: int = Field(128, ge=1, le=10_000)
    shrinkage: float = Field(0.7, ge=0.01, le=1)
    seed: int = 21
    perturb: PerturbConfig = PerturbConfig()


class SelfTestConfig(Stage):
    """How much is tested."""

    queries: int = Field(160, ge=0, le=100_000)
    outside: int = Field(40, ge=0, le=100_000)
    seed: int = 20
    perturb: PerturbConfig = PerturbConfig()


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
