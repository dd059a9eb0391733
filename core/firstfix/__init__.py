"""firstfix: the pose of a LiDAR robot in a known map, from one scan.

The names here are those that users may rely on; everything else may change. They are loaded on first use, so
``import firstfix`` is light. Types for editors and type checkers stand in ``__init__.pyi``.

    Scan, ScanSequence, CompactScan           one query's scans
    ScanDescriptor, DescriptorParameters      a scan described on the robot, and what that takes
    condense, describe                        a scan to its compact form, or to its descriptor alone
    read_scan_file, decode_query              a file or a request body to scans
    LocalizeOptions, Prior                    options of a query
    Localization, Verdict, Reason             its answer
    Hypothesis, AlignmentQuality              the poses that the answer compares
    MapIndex, Localizer, localize_among       a map version in this process, and queries to it
    Deadline                                  the time of a query, which can be cancelled
    SensorModel, BuildConfig                  parameters of a build
    Store, Catalog, Manifest                  maps and versions in object storage
    FirstfixError, errors                     base of all errors, and the module that lists them
    transform                                 module of rigid transforms
"""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

_HOME = {
    "AlignmentQuality": ".answer.quality",
    "BuildConfig": ".builds.config",
    "Catalog": ".catalog.catalog",
    "CompactScan": ".scan.compact",
    "Deadline": ".engine.deadline",
    "DescriptorParameters": ".scan.descriptor_parameters",
    "FirstfixError": ".errors",
    "Hypothesis": ".answer.localization",
    "Localization": ".answer.localization",
    "LocalizeOptions": ".answer.options",
    "Localizer": ".engine.localizer",
    "Manifest": ".catalog.manifest",
    "MapIndex": ".engine.index",
    "Prior": ".answer.prior",
    "Reason": ".answer.localization",
    "Scan": ".scan.scan",
    "ScanDescriptor": ".scan.compact",
    "ScanSequence": ".scan.sequence",
    "SensorModel": ".sensor",
    "Store": ".store.store",
    "Verdict": ".answer.localization",
    "condense": ".scan.condense",
    "decode_query": ".decode",
    "describe": ".scan.condense",
    "localize_among": ".engine.localizer",
    "read_scan_file": ".scan_file",
}
_MODULES = ("errors", "transform")

__all__ = ["__version__", *_HOME, *_MODULES]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return import_module(f".{name}", __name__)
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        value = getattr(import_module(_HOME[name], __name__), name)
    except ModuleNotFoundError as error:
        if error.name is None:  # of firstfix.native, which says itself what to do
            raise
        from .errors import pip_install

        raise ImportError(f"firstfix.{name} needs {error.name}: {pip_install('.[service]')}") from error
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
