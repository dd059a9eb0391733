"""Configuration of an index and of its queries: stored with the version and read back from it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

from pydantic import BaseModel, ConfigDict, Field

from ..descriptor import Descriptor, LayeredOccupancy, PolarGrid
from ..descriptor.pca_sc import PcaScanContext
from .ranking import RANKING, RankingConfig

ENGINE_FILE = "engine.json"


class Stage(BaseModel):
    """Base of every stage's config: immutable, and a misspelt key is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class PolarConfig(Stage):
    """Polar grid into which a descriptor bins a scan."""

    rings: int = Field(20, ge=2, le=200)
    sectors: int = Field(60, ge=8, le=720)
    max_range_m: float = Field(60.0, gt=1, le=500)

    @property
    def grid(self) -> PolarGrid:
        """The grid."""
        return PolarGrid(self.rings, self.sectors, self.max_range_m)


class OccupancyConfig(PolarConfig):
    """Parameters of ``descriptor.LayeredOccupancy``, the default."""

    kind: Literal["occupancy"] = "occupancy"
    layer_edges_m: tuple[float, ...] = Field((0.3, 1.0, 1.8, 3.0, 6.0, 25.0), min_length=2, max_length=17)
    coefficients: int = Field(8, ge=1, le=30)

    def make(self) -> Descriptor:
        """Descriptor with these parameters."""
        return LayeredOccupancy(self.grid, self.layer_edges_m, self.coefficients)


class PcaScConfig(PolarConfig):
    """Parameters of ``descriptor.pca_sc.PcaScanContext``, the paper's descriptor."""

    kind: Literal["pca_sc"] = "pca_sc"
    height_origin: Literal["floor", "sensor"] = "floor"
    ground: Literal["raw", "keep", "drop"] = "drop"
    ground_m: float = Field(0.3, ge=0, le=5)
    max_ratio: float = Field(0.9, ge=0, le=1)
    trusted_shifts: int = Field(1, ge=0, le=360)

    def make(self) -> Descriptor:
        """Descriptor with these parameters."""
        return PcaScanContext(
            self.grid, self.height_origin, self.ground, self.ground_m, self.max_ratio, self.trusted_shifts
        )


DescriptorConfig: TypeAlias = Annotated[OccupancyConfig | PcaScConfig, Field(discriminator="kind")]


class ClusterConfig(Stage):
    """Clustering of templates (paper III.B).

    Attributes:
        threshold: largest distance, 1 - similarity, at which clusters are merged.
        neighbours: number of templates, nearest by position, with which each is compared; its distance to all
            others is 1. None: all templates are compared.
    """

    linkage: Literal["complete", "average", "single"] = "complete"
    threshold: float = Field(0.1, ge=0, lt=1)
    neighbours: int | None = Field(50, ge=1, le=10_000)


class PreprocessConfig(Stage):
    """Preprocessing of scans."""

    min_range_m: float = Field(0.5, ge=0)
    max_range_m: float = Field(100.0, gt=1)
    voxel_m: float = Field(0.25, gt=0.01, le=5, description="voxel size of the registered points")
    min_points: int = Field(200, ge=10, description="a scan with fewer voxels cannot be localized")
    default_height_m: float = Field(1.0, ge=0, description="sensor height if no floor is seen")


class LshConfig(Stage):
    """Hash tables of ``key_search.LshKdTree`` (paper III.C).

    Attributes:
        bits: length of a hash.
        random_tables: number of tables with random directions (RBP), beside the one with principal directions
            (PCA-BP).
        probes: buckets to search in every table.
    """

    bits: int = Field(6, ge=1, le=24)
    random_tables: int = Field(2, ge=0, le=64)
    probes: int = Field(3, ge=1, le=1000)
    seed: int = Field(0, ge=0)


class EffortConfig(Stage):
    """Work of one step of the effort levels (docs/method.md section 7.1), however large the map is.

    The scan is levelled in several ways, which share the first two numbers.
    """

    clusters: int = Field(ge=1, le=1_000_000, description="clusters whose templates are compared")
    screened: int = Field(ge=1, le=100_000, description="poses that are scored on the coarse grid")
    candidates: int = Field(ge=1, le=1000, description="best of them, which are registered")


class AliasConfig(Stage):
    """Places known to look alike, which compete with an accepted pose (docs/method.md section 7.1).

    The build keeps the aliases, so the first two numbers change nothing in a version that is there.
    """

    each: int = Field(8, ge=1, le=100, description="aliases of a template that are kept")
    clusters: int = Field(400, ge=1, le=100_000, description="clusters that a template's aliases come from")
    templates: int = Field(4, ge=1, le=100, description="templates nearest to the pose whose aliases count")
    near_m: float = Field(5.0, gt=0, le=1000, description="templates further from the pose do not count")
    screened: int = Field(20, ge=1, le=1000, description="aliases that are screened, most alike first")
    behind: float = Field(
        0.15, ge=0, le=1, description="aliases that are screened this much worse than the pose are left out"
    )
    tried: int = Field(4, ge=1, le=1000, description="aliases that are aligned, best screened first")


class SearchConfig(Stage):
    """Parameters of the cascade: find the clusters nearest by key, then compare their templates.

    Attributes:
        engine: search engine of the keys. "auto": "faiss_sq8", or "faiss_ivf_sq8" if there are too many keys
            to read them all.
        wide, exhaustive: the next effort levels, if the first search is not convincing.
    """

    engine: Literal["auto", "exhaustive", "kdtree", "lsh_kdtree", "faiss_sq8", "faiss_ivf_sq8"] = "auto"
    lsh: LshConfig = LshConfig()
    shard_keys: int = Field(250_000, ge=100, description="about this many keys in each FAISS index")
    clusters: int = Field(400, ge=1, le=100_000, description="clusters whose templates are compared")
    candidates: int = Field(20, ge=1, le=100, description="candidates that are registered")
    widened: int = Field(
        4, ge=1, le=100, description="factor on both for a descriptor alone; 1: no scan is searched for twice"
    )
    wide: EffortConfig = EffortConfig(clusters=10_000, screened=2000, candidates=60)
    exhaustive: EffortConfig = EffortConfig(clusters=30_000, screened=3500, candidates=60)
    aliases: AliasConfig = AliasConfig()


class RegistrationConfig(Stage):
    """Point-to-plane registration, on a coarse grid of the map and then on its own points."""

    map_voxel_m: float = Field(0.1, gt=0.01, le=5)
    coarse_voxel_m: float = Field(0.6, gt=0.05, le=20)
    coarse_iterations: int = Field(10, ge=1, le=200)
    align_iterations: int = Field(4, ge=1, le=200, description="on the map's own points, for every candidate")
    fine_distance_m: float = Field(0.5, gt=0.01, le=20)
    inlier_distance_m: float = Field(0.15, gt=0.01, le=5)


class VerificationConfig(Stage):
    """Verification of registered candidates."""

    reach_m: float = Field(25.0, gt=1, le=200, description="distance to which free space is checked")
    compared: int = Field(100, ge=1, le=1000, description="candidates that compete")


class NearbyConfig(Stage):
    """Search beside the best place for a better alignment (docs/method.md section 7.2).

    Attributes:
        reach_m: from the place to the furthest start; 0: no search.
        step_m: between starts.
        points: of the scan, with which starts are aligned.
        worse_by: a start that ends with an alignment score worse by more is not aligned finely.
        refined: starts that are aligned finely, at most.
        apart_m, apart_deg: nearer ends of two starts are one.
        better_by: alignment score of another minimum over that of the place.
    """

    reach_m: float = Field(3.0, ge=0, le=20)
    step_m: float = Field(0.5, ge=0.1, le=5)
    points: int = Field(200, ge=10, le=10_000)
    worse_by: float = Field(0.05, ge=0, le=1)
    refined: int = Field(6, ge=1, le=50)
    apart_m: float = Field(0.15, ge=0, le=5)
    apart_deg: float = Field(1.0, ge=0, le=90)
    better_by: float = Field(0.01, ge=0, le=1)


class EngineConfig(Stage):
    """Configuration of a map version, for its build and its queries.

    Attributes:
        cluster: None: every template is a cluster of its own.
        spacing_m: distance between templates.
        T_map_level: (4, 4), row-major, from the index's frame, whose z is up, to the map's.
    """

    descriptor: DescriptorConfig = OccupancyConfig()
    preprocess: PreprocessConfig = PreprocessConfig()
    cluster: ClusterConfig | None = None
    search: SearchConfig = SearchConfig()
    registration: RegistrationConfig = RegistrationConfig()
    nearby: NearbyConfig = NearbyConfig()
    verification: VerificationConfig = VerificationConfig()
    ranking: RankingConfig = RANKING
    spacing_m: float = Field(1.0, gt=0)
    T_map_level: tuple[float, ...] = Field(
        (1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1), min_length=16, max_length=16
    )

    @classmethod
    def load(cls, directory: Path) -> EngineConfig:
        """Read a version's file.

        Raises:
            IncompatibleVersion: the version has other numbers than this release ranks by.
            ValueError, OSError: the file is missing or damaged.
        """
        stored = json.loads((directory / ENGINE_FILE).read_text())
        if not isinstance(stored, dict):
            raise ValueError(f"{ENGINE_FILE} is not an object")
        return cls.model_validate({**stored, "ranking": RankingConfig.from_stored(stored.get("ranking"))})
