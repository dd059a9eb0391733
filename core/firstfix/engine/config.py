"""What made an index, and how it is to be queried: stored with the version, read back from it."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

from pydantic import BaseModel, ConfigDict, Field

from ..descriptor import Descriptor, LayeredOccupancy, PolarGrid
from ..descriptor.pca_sc import PcaScanContext


class Stage(BaseModel):
    """Base of every stage's config: immutable, and a misspelt key is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class PolarConfig(Stage):
    """The polar grid that a descriptor bins a scan into."""

    rings: int = Field(20, ge=2, le=200)
    sectors: int = Field(60, ge=8, le=720)
    max_range_m: float = Field(60.0, gt=1, le=500)

    @property
    def grid(self) -> PolarGrid:
        return PolarGrid(self.rings, self.sectors, self.max_range_m)


class OccupancyConfig(PolarConfig):
    """``descriptor.LayeredOccupancy``: the default."""

    kind: Literal["occupancy"] = "occupancy"
    layer_edges_m: tuple[float, ...] = Field((0.3, 1.0, 1.8, 3.0, 6.0, 25.0), min_length=2, max_length=17)
    coefficients: int = Field(8, ge=1, le=30)

    def make(self) -> Descriptor:
        return LayeredOccupancy(self.grid, self.layer_edges_m, self.coefficients)


class PcaScConfig(PolarConfig):
    """``descriptor.pca_sc.PcaScanContext``: the paper's."""

    kind: Literal["pca_sc"] = "pca_sc"
    height_origin: Literal["floor", "sensor"] = "floor"
    ground: Literal["raw", "keep", "drop"] = "drop"
    ground_m: float = Field(0.3, ge=0, le=5)
    max_ratio: float = Field(0.9, ge=0, le=1)
    trusted_shifts: int = Field(1, ge=0, le=360)

    def make(self) -> Descriptor:
        return PcaScanContext(
            self.grid, self.height_origin, self.ground, self.ground_m, self.max_ratio, self.trusted_shifts
        )


DescriptorConfig: TypeAlias = Annotated[OccupancyConfig | PcaScConfig, Field(discriminator="kind")]


class ClusterConfig(Stage):
    """How templates are grouped (paper III.B).

    Attributes:
        threshold: largest distance that is merged, 1 - similarity.
        neighbours: nearest by position that a template is compared with; all others count as wholly
            unlike. None: all templates are compared.
    """

    linkage: Literal["complete", "average", "single"] = "complete"
    threshold: float = Field(0.1, ge=0, lt=1)
    neighbours: int | None = Field(50, ge=1, le=10_000)


class PreprocessConfig(Stage):
    """What of a scan is used."""

    min_range_m: float = Field(0.5, ge=0)
    max_range_m: float = Field(100.0, gt=1)
    voxel_m: float = Field(0.25, gt=0.01, le=5, description="of the points that are registered")
    min_points: int = Field(200, ge=10, description="fewer voxels than this cannot be localized")
    default_height_m: float = Field(1.0, ge=0, description="of the sensor, where no floor is seen")


class LshConfig(Stage):
    """Hash tables of ``key_search.LshKdTree`` (paper III.C).

    Attributes:
        bits: of a hash.
        random_tables: with random directions (RBP), beside the one with the principal ones (PCA-BP).
        probes: buckets looked into in every table.
    """

    bits: int = Field(6, ge=1, le=24)
    random_tables: int = Field(2, ge=0, le=64)
    probes: int = Field(3, ge=1, le=1000)
    seed: int = Field(0, ge=0)


class SearchConfig(Stage):
    """The cascade: clusters nearest by their representatives' keys, then their templates compared.

    Attributes:
        engine: "auto": "faiss_sq8", or "faiss_ivf_sq8" where there are too many keys to read them all.
    """

    engine: Literal[
        "auto",
        "exhaustive",
        "kdtree",
        "lsh_kdtree",
        "faiss_flat",
        "faiss_sq8",
        "faiss_ivf",
        "faiss_ivf_sq8",
        "faiss_ivf_pq",
        "faiss_hnsw",
    ] = "auto"
    lsh: LshConfig = LshConfig()
    shard_keys: int = Field(250_000, ge=100, description="about so many in an index of a FAISS engine")
    clusters: int = Field(400, ge=1, le=100_000, description="whose templates are compared")
    candidates: int = Field(20, ge=1, le=100, description="templates whose poses are registered")
    widened: int = Field(
        4, ge=1, le=100, description="times as many of both, where the first were not convincing; 1: never"
    )


class RegistrationConfig(Stage):
    """Point to plane, on a coarse grid of the map and then on its own points."""

    map_voxel_m: float = Field(0.1, gt=0.01, le=5)
    coarse_voxel_m: float = Field(0.6, gt=0.05, le=20)
    coarse_iterations: int = Field(10, ge=1, le=200)
    align_iterations: int = Field(4, ge=1, le=200, description="on the map's own points, of every candidate")
    fine_distance_m: float = Field(0.5, gt=0.01, le=20)
    fine_iterations: int = Field(12, ge=1, le=200)
    inlier_distance_m: float = Field(0.15, gt=0.01, le=5)


class VerificationConfig(Stage):
    """What is looked at before a place is believed."""

    reach_m: float = Field(25.0, gt=1, le=200, description="to which free space is checked")
    compared: int = Field(5, ge=1, le=100, description="places that the best is told apart from")


class EngineConfig(Stage):
    """Everything that the query flow takes from the version.

    Attributes:
        cluster: None: every template stands for itself.
        T_map_level: row-major (4, 4): the index lives in a frame whose z is up, whatever the map's.
    """

    descriptor: DescriptorConfig = OccupancyConfig()
    preprocess: PreprocessConfig = PreprocessConfig()
    cluster: ClusterConfig | None = None
    search: SearchConfig = SearchConfig()
    registration: RegistrationConfig = RegistrationConfig()
    verification: VerificationConfig = VerificationConfig()
    spacing_m: float = Field(1.0, gt=0)
    T_map_level: tuple[float, ...] = Field(
        (1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1), min_length=16, max_length=16
    )
