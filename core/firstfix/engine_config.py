"""What made an index, and how it is to be queried: stored with the version, read back from it."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field

from .occupancy import LayeredGrid
from .polar import PolarGrid


class Stage(BaseModel):
    """Base of every stage's config: immutable, and a misspelt key is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class DescriptorConfig(Stage):
    """The grids of both descriptors: PCA-SC (paper III.A) and layered occupancy."""

    rings: int = Field(20, ge=2, le=200)
    sectors: int = Field(60, ge=8, le=720)
    max_range_m: float = Field(60.0, gt=1, le=500)
    layer_edges_m: tuple[float, ...] = Field((0.3, 1.0, 1.8, 3.0, 6.0, 25.0), min_length=2, max_length=17)
    coefficients: int = Field(8, ge=1, le=30)

    @property
    def polar(self) -> PolarGrid:
        return PolarGrid(self.rings, self.sectors, self.max_range_m)

    @property
    def layered(self) -> LayeredGrid:
        return LayeredGrid(self.polar, self.layer_edges_m)


class PreprocessConfig(Stage):
    """What of a scan is used."""

    min_range_m: float = Field(0.5, ge=0)
    max_range_m: float = Field(100.0, gt=1)
    voxel_m: float = Field(0.25, gt=0.01, le=5, description="of the points that are registered")
    min_points: int = Field(200, ge=10, description="fewer voxels than this cannot be localized")
    default_height_m: float = Field(1.0, ge=0, description="of the sensor, where no floor is seen")


class SearchConfig(Stage):
    """How candidates are proposed."""

    by_key: int = Field(400, ge=1, le=100_000, description="templates nearest by key, then re-ranked")
    candidates: int = Field(10, ge=1, le=100, description="that are registered")


class RegistrationConfig(Stage):
    """Coarse VGICP against Gaussian voxels, then GICP against the map's points."""

    map_voxel_m: float = Field(0.1, gt=0.01, le=5)
    coarse_voxel_m: float = Field(0.6, gt=0.05, le=20)
    coarse_iterations: int = Field(15, ge=1, le=200)
    fine_distance_m: float = Field(0.5, gt=0.01, le=20)
    fine_iterations: int = Field(12, ge=1, le=200)
    inlier_distance_m: float = Field(0.15, gt=0.01, le=5)


class EngineConfig(Stage):
    """Everything that the query flow takes from the version.

    Attributes:
        T_map_level: row-major (4, 4): the index lives in a frame whose z is up, whatever the map's.
    """

    descriptor: DescriptorConfig = DescriptorConfig()
    preprocess: PreprocessConfig = PreprocessConfig()
    search: SearchConfig = SearchConfig()
    registration: RegistrationConfig = RegistrationConfig()
    spacing_m: float = Field(1.0, gt=0)
    T_map_level: tuple[float, ...] = Field(
        (1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1), min_length=16, max_length=16
    )
