"""Config of a build: one small model for each stage, with working defaults.

It is part of the core so that the service can check a config without the builder.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Literal

import yaml
from pydantic import Field, ValidationError, field_validator, model_validator

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
from .plain_problems import plain_problems


class CleanConfig(Stage):
    """Thinning of the cloud and removal of stray points.

    Attributes:
        voxel_m: points of one voxel are replaced by their mean; None keeps every point.
        max_points: the voxel grows until the cloud has fewer points. Bounds the time of a build.
        radius_spacings: radius of a point's neighbourhood, in point spacings.
        min_neighbours: a point with fewer neighbours is removed; 0 keeps all.
        passes: a point goes that so many scans of the mapping run saw through, and three times as many as met
            it; 0 keeps all. Only of maps that bring their scans.
        most_passed: if a larger share of the points would go so, none goes.
    """

    voxel_m: float | None = Field(0.08, gt=0, le=10)
    max_points: int = Field(4_000_000, ge=1_000)
    radius_spacings: float = Field(4.0, gt=0, le=100)
    min_neighbours: int = Field(3, ge=0, le=100)
    passes: int = Field(2, ge=0, le=1000)
    most_passed: float = Field(0.15, ge=0, le=1)


class ReconstructConfig(Stage):
    """Reconstruction of the surface. Lengths follow the point spacing unless given.

    Attributes:
        surface: "signed-distance": where the distance from the planes of the cloud's cells is zero;
            "poisson": screened Poisson, which takes ten times as long; "auto": Poisson for the paper's
            method, and for an uneven cloud without a trajectory, otherwise the signed distance.
        cell_m: edge of the finest cell; None: ``cell_spacings`` point spacings.
        cell_spacings: see ``cell_m``; None: 1.4, or 1.2 with Poisson.
        trim_spacings: surface further than this from every point is cut away; None: 1.75, or 2 with Poisson.
        normal_spacings, normal_neighbours: Poisson: radius and largest number of points for a normal.
        point_weight: Poisson: weight of the points against smoothness.
        tile_cells: edge of a tile in cells; its square bounds memory. None: 192, or 384 with Poisson.
        margin_cells: margin that a tile reads around itself, so that neighbours agree at their border.
    """

    surface: Literal["auto", "signed-distance", "poisson"] = "auto"
    cell_m: float | None = Field(None, gt=0, le=10)
    cell_spacings: float | None = Field(None, gt=0, le=20)
    trim_spacings: float | None = Field(None, gt=0, le=100)
    normal_spacings: float = Field(4.0, gt=1, le=100)
    normal_neighbours: int = Field(20, ge=3, le=200)
    point_weight: float = Field(1.0, ge=0, le=100)
    tile_cells: int | None = Field(None, ge=32, le=4096)
    margin_cells: int = Field(12, ge=8, le=256)

    @property
    def spacings_per_cell(self) -> float:
        """Edge of the finest cell in point spacings."""
        return self.cell_spacings or (1.2 if self.surface == "poisson" else 1.4)

    @property
    def cells_per_tile(self) -> int:
        """Edge of a tile in cells."""
        return self.tile_cells or (384 if self.surface == "poisson" else 192)

    @property
    def trimmed_spacings(self) -> float:
        """Distance in point spacings beyond which surface is cut away."""
        return self.trim_spacings or (2.0 if self.surface == "poisson" else 1.75)


class ViewpointConfig(Stage):
    """Sampling of viewpoints on the traversable floor.

    Attributes:
        spacing_m: edge of the squares with one viewpoint each; None: 1 m, or what ``fit_spacing`` finds
            better.
        mount_height_m: height of the sensor over the floor; "auto": from the trajectory if there is one,
            otherwise from the sensor model.
        max_slope_deg, step_height_m: limits of the robot. Reconstructed floors are bumpy: be generous.
        robot_height_m: free height that the robot needs; at least the sensor has to fit below.
        footprint_radius_m: free distance that the robot needs on every side.
        bridge_gap_m: holes in the floor up to this width do not stop the robot.
        max_distance_to_trajectory_m: largest distance of a viewpoint from the trajectory; None: no limit.
        tile_m: edge of the square tiles in which templates are made and stored, one after the other.
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
    """Ray casting of templates. The descriptor's cells are coarser than most sensors' rays."""

    max_rays: int = Field(16_384, ge=500, le=1_000_000)


class PerturbConfig(Stage):
    """Standard deviations and means of perturbations of a scan."""

    noise_m: float = Field(0.02, ge=0, le=1)
    dropout: float = Field(0.1, ge=0, lt=1)
    occluders: float = Field(6.0, ge=0, le=100, description="passers-by, on average")
    strangers: float = Field(
        3.0, ge=0, le=100, description="car-sized objects that the map lacks, on average"
    )
    unmapped: float = Field(
        3.0,
        ge=0,
        le=100,
        description="share of azimuth in which surfaces were never mapped, on average, in multiples of the "
        "share of rays that escape through holes of the map; 0: the holes stay open",
    )
    vanished: float = Field(0.5, ge=0, le=100, description="mapped things that have left, on average")
    height_m: float = Field(0.05, ge=0, le=1)
    tilt_deg: float = Field(2.0, ge=0, le=45)


class LearnKeysConfig(Stage):
    """Learned projection of keys.

    Attributes:
        scans: largest number of simulated scans to learn from, one for every four templates; 0: keys are not
            projected.
        numbers: dimension of a projected key.
        shrinkage: regularisation of the perturbations' covariance. With a small value keys find more scans
            like the simulated ones, and fewer of other sensors or with large occlusions.
    """

    scans: int = Field(800, ge=0, le=100_000)
    numbers: int = Field(128, ge=1, le=10_000)
    shrinkage: float = Field(0.7, ge=0.01, le=1)
    seed: int = 21
    perturb: PerturbConfig = PerturbConfig(unmapped=0, vanished=0)  # keys are of what is mapped


class SelfTestConfig(Stage):
    """Numbers of simulated queries of the self-test, inside and outside the map.

    Attributes:
        until_decided: end as soon as what the self-test decides will hardly change; else ask all.
        queries: scans in the map, at places between the templates.
        rough: share of the queries that are disturbed more than real scans are.
        outside: scans of strange places, at most as many as ship with the release.
        max_false_accept: share of the answers ``localized`` that may be wrong. The map's threshold follows.
        held_out: largest number of keyframes that a map is made without, to be asked, too; 0: none. Only of
            maps that are made of their scans, a tenth of them at most.
        confirmed: largest number of recorded queries that are asked, too, because somebody has told where
            their scans were taken; 0: none. Only builds of a map in a store find them.
    """

    until_decided: bool = True
    queries: int = Field(120, ge=0, le=100_000)
    rough: float = Field(1 / 3, ge=0, le=1)
    outside: int = Field(24, ge=0, le=100_000)
    max_false_accept: float = Field(0.005, gt=0, le=0.1)
    held_out: int = Field(40, ge=0, le=200)
    confirmed: int = Field(40, ge=0, le=200)
    seed: int = 20
    # As much as real scans differ from their maps, or a little more (lab/docs/experiments.md).
    perturb: PerturbConfig = PerturbConfig(occluders=2, strangers=1, unmapped=1)
    perturb_roughly: PerturbConfig = PerturbConfig()


MIN_LOCALIZED_IS_GONE = (
    "{old} is {new} now: the least share of the self-test's scans whose place is found, localized or not"
)


class ActivateConfig(Stage):
    """When a version that was built is activated by itself. Otherwise it is published only, with the reason.

    Attributes:
        min_found: least share of the self-test's scans in the map whose place is found: it is the best one,
            or ties with the best; 0: any.
        min_real_found: the same of real scans that the map's source holds out. A version is held back if so
            few are found by chance in less than 1 of 20 cases; 0: never.
        max_loss: by so much the first share may be less than the active version's; 1: by any.
    """

    min_found: float = Field(0.7, ge=0, le=1)
    min_real_found: float = Field(0.8, ge=0, le=1)
    max_loss: float = Field(0.1, ge=0, le=1)

    @model_validator(mode="before")
    @classmethod
    def _renamed(cls, values: Any) -> Any:
        if isinstance(values, dict) and "min_localized" in values:
            raise ValueError(MIN_LOCALIZED_IS_GONE.format(old="min_localized", new="min_found"))
        return values


PatchMode = Literal["off", "propose", "activate"]


class EngineOverrides(Stage):
    """Parts of the engine's config that are set by hand. None: derived from the map and the sensor.

    Attributes:
        method: "default"; or "paper": PCA-SC, clusters, CNZ keys in hash tables and KD trees.
        cluster: None with the default method: templates are not clustered.
    """

    method: Literal["default", "paper"] = "default"
    descriptor: DescriptorConfig | None = None
    preprocess: PreprocessConfig | None = None
    cluster: ClusterConfig | None = None
    search: SearchConfig | None = None
    registration: RegistrationConfig | None = None
    verification: VerificationConfig | None = None


class BuildConfig(Stage):
    """Config of a whole build. Together with the source it determines the version's digest.

    Attributes:
        sensor: name of a preset, or a mapping as in a sensor YAML.
        axis: axis of the source that points up.
        scale: metres in one unit of the source: 0.001 for millimetres.
        trajectory_mount_height_m: height of the sensor over the poses of the trajectory, where those are
            of the robot's base: along each pose's own z. 0: they are the sensor's.
        level: rotate a tilted map so that z points up in the index.
        provisional: a map without a full version gets a provisional one first: coarse, little tested, and
            served until the full one takes its place. This option does not change the full version.
        patch: what becomes of patches of this map by recorded queries: "off": none is made; "propose": the
            patched version waits until somebody activates it; "activate": it is activated, unless it is
            worse.
        exact: keep nothing of the map's active version: the new one is to the last bit that of a build from
            nothing.
        base: version of which learned keys and calibration may be kept. A build names it by itself: the
            map's active version. None: nothing is kept.
    """

    sensor: str | dict[str, Any] = "os1-64"
    axis: Literal["z-up", "y-up"] = "z-up"
    scale: float = Field(1.0, gt=0, le=1e6)
    trajectory_mount_height_m: float = Field(0.0, ge=0, le=100)
    level: bool = True
    provisional: bool = True
    clean: CleanConfig = CleanConfig()
    reconstruct: ReconstructConfig = ReconstructConfig()
    viewpoints: ViewpointConfig = ViewpointConfig()
    simulate: SimulateConfig = SimulateConfig()
    engine: EngineOverrides = EngineOverrides()
    learn_keys: LearnKeysConfig = LearnKeysConfig()
    self_test: SelfTestConfig = Field(default_factory=SelfTestConfig)
    activate: ActivateConfig = ActivateConfig()
    patch: PatchMode = "off"
    exact: bool = False
    base: str | None = Field(None, pattern="^[0-9a-f]{64}$")

    @field_validator("patch", mode="before")
    @classmethod
    def _yaml_off(cls, value: Any) -> Any:
        return "off" if value is False else value  # YAML reads the bare word as false

    @field_validator("sensor")
    @classmethod
    def _known_sensor(cls, value: str | dict[str, Any]) -> str | dict[str, Any]:
        _sensor(value)
        return value

    @property
    def sensor_model(self) -> SensorModel:
        """Model of the sensor."""
        return _sensor(self.sensor)

    @property
    def surface(self) -> ReconstructConfig:
        """Reconstruction of the surface. The paper's method has Poisson's unless another is named."""
        if self.engine.method == "paper" and self.reconstruct.surface == "auto":
            return self.reconstruct.model_copy(update={"surface": "poisson"})
        return self.reconstruct

    @classmethod
    def parse(cls, data: Any) -> BuildConfig:
        """Parse JSON-like data.

        Raises:
            InvalidOption: a key is unknown or a value is out of range; the message names it.
        """
        try:
            return cls.model_validate(data)
        except ValidationError as error:
            raise InvalidOption(f"build config: {plain_problems(error)}") from None

    @classmethod
    def from_file(cls, path: Path) -> BuildConfig:
        """Read a YAML or JSON file.

        Raises:
            InvalidOption: the file is malformed; or see ``parse``.
        """
        try:
            return cls.parse(yaml.safe_load(path.read_text()) or {})
        except (yaml.YAMLError, UnicodeDecodeError) as error:
            raise InvalidOption(f"{path}: {error}") from None

    def to_mapping(self) -> dict[str, Any]:
        """JSON-ready form of what decides the version.

        Without ``provisional``, ``activate``, ``patch`` and ``exact``, and without a ``base`` that is None.
        """
        left_out = {"provisional", "activate", "patch", "exact"} | ({"base"} if self.base is None else set())
        mapping: dict[str, Any] = json.loads(self.model_dump_json(exclude=left_out))
        return mapping


def _sensor(value: str | dict[str, Any]) -> SensorModel:
    try:
        return preset(value) if isinstance(value, str) else SensorModel.from_mapping(value)
    except InvalidOption as error:
        raise ValueError(str(error)) from None
