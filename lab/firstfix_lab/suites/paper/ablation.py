"""Ablation of the choices that the paper leaves open: one is changed at a time."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from firstfix.descriptor import Described
from firstfix.descriptor.pca_sc import PcaScanContext
from firstfix.engine.config import ClusterConfig, SearchConfig
from firstfix.engine.retrieval.cascade import Clusters
from firstfix_builder.templates.cluster import cluster_templates

from .matching import CascadeRun, make_cascade, run_cascade, success
from .scene import DESCRIPTORS, PAPER, Scene, Taken
from .tables import K

CLUSTER = ClusterConfig()


@dataclass(frozen=True)
class Variant:
    """One choice, changed.

    Attributes:
        scans: how templates and queries are described, a name in DESCRIPTORS.
        signed: whether the axis points to the side of the points' mean; else as the eigenvector comes.
    """

    choice: str
    value: Any
    scans: str = PAPER
    signed: bool = True
    cluster: ClusterConfig | None = CLUSTER
    clusters_searched: int = K
    changes: tuple[tuple[str, Any], ...] = ()


VARIANTS = (
    *(Variant("ground cells", ground, ground) for ground in ("drop", "keep", "raw")),
    Variant("axis sign", "side of the mean"),
    Variant("axis sign", "none", signed=False),
    *(Variant("shifts, axis trusted", n, changes=(("trusted_shifts", n),)) for n in (0, 1, 2, 5, 30)),
    *(Variant("axis trusted below ratio", r, changes=(("max_ratio", r),)) for r in (0.0, 0.7, 0.8, 0.9, 1.0)),
    *(Variant("K", k, clusters_searched=k) for k in (1, 5, 10, 20, 50, 200)),
    Variant("threshold", "no clusters", cluster=None),
    *(Variant("threshold", t, cluster=ClusterConfig(threshold=t)) for t in (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)),
    *(Variant("neighbours", n, cluster=ClusterConfig(neighbours=n)) for n in (10, 25, 50, 100)),
)


def ablate(scene: Scene, own: Taken, perturbed: Taken) -> list[dict[str, Any]]:
    """Success of every variant, with the templates as queries and with held-out perturbed ones."""
    made: dict[Any, Clusters] = {}
    ran: dict[Any, list[CascadeRun]] = {}  # the unchanged choices stand among the values of each
    rows = []
    for variant, how, templates, asked in _each(scene, (own, perturbed)):
        key = (variant.scans, variant.signed, variant.cluster)
        if key not in made:
            made[key] = _clusters(how, templates, variant)
        case = (*key, how, variant.clusters_searched)
        if case not in ran:
            cascade = make_cascade(templates, made[key], SearchConfig(engine="kdtree"), variant.scans)
            cascade = replace(cascade, descriptor=how)
            ran[case] = [run_cascade(cascade, described, variant.clusters_searched) for described in asked]
        runs = ran[case]
        row = {
            "choice": variant.choice,
            "value": variant.value,
            "clusters": len(made[key]),
            "ms": round(runs[1].search_ms + runs[1].match_ms, 3),
            "success": success(templates.position_m[runs[0].found], own.position_m),
            "success_perturbed": success(templates.position_m[runs[1].found], perturbed.position_m),
        }
        print("ablation", row, file=sys.stderr, flush=True)
        rows.append(row)
    return rows


def _each(
    scene: Scene, queries: tuple[Taken, Taken]
) -> Iterator[tuple[Variant, PcaScanContext, Taken, list[Described]]]:
    for variant in VARIANTS:
        how = DESCRIPTORS[variant.scans]
        assert isinstance(how, PcaScanContext)
        templates, asked = scene.templates, [q.by[variant.scans] for q in queries]
        if not variant.signed:
            templates = replace(templates, by={variant.scans: _unsigned(templates.by[variant.scans])})
            asked = [_unsigned(described) for described in asked]
        yield variant, replace(how, **dict(variant.changes)), templates, asked


def _clusters(how: PcaScanContext, templates: Taken, variant: Variant) -> Clusters:
    if variant.cluster is None:
        return Clusters.alone(len(templates))
    return cluster_templates(how, templates.by[variant.scans], templates.position_m, variant.cluster)


def _unsigned(described: Described) -> Described:
    """The axis in (-90, 90] degrees: half a turn, and so half the columns, from where it pointed."""
    angle, context = described["angle_rad"], described["context"]
    back = np.abs(angle) > np.pi / 2
    turned = np.where(angle > 0, angle - np.pi, angle + np.pi)
    rolled = np.roll(context, context.shape[2] // 2, axis=2)
    return {
        "angle_rad": np.where(back, turned, angle),
        "ratio": described["ratio"],
        "context": np.where(back[:, None, None], rolled, context),
    }
