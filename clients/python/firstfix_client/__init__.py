"""The robot's side of firstfix: send a LiDAR scan, get the robot's pose in the map.

    from firstfix_client import Client

    with Client("http://localhost:8080") as client:
        fix = client.localize(points, map_id="hall")
    if fix.T_map_sensor is not None:
        ...

``AsyncClient`` is the same for asyncio. ``ZenohClient`` works over zenoh and needs the extra ``zenoh``.
The public names of this package are those in ``__all__``; every other name may change. A name is imported on
first use, so unused names cost no start-up time.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from firstfix import __version__ as __version__

if TYPE_CHECKING:
    from firstfix.answer.localization import Hypothesis, Localization, Reason, Verdict
    from firstfix.answer.options import LocalizeOptions
    from firstfix.answer.prior import Prior
    from firstfix.errors import FirstfixError
    from firstfix.scan.descriptor_parameters import DescriptorParameters
    from firstfix.scan.scan import Scan
    from firstfix.scan.sequence import ScanSequence

    from .async_client import AsyncClient
    from .client import Client
    from .errors import ServiceUnreachable
    from .policies import HedgePolicy, RetryPolicy
    from .records import BuildStatus, MapInfo, ReplicaInfo, VersionInfo
    from .version_watch import VersionChange, VersionWatch
    from .zenoh_client import ZenohClient

__all__ = [
    "AsyncClient",
    "BuildStatus",
    "Client",
    "DescriptorParameters",
    "FirstfixError",
    "HedgePolicy",
    "Hypothesis",
    "Localization",
    "LocalizeOptions",
    "MapInfo",
    "Prior",
    "Reason",
    "ReplicaInfo",
    "RetryPolicy",
    "Scan",
    "ScanSequence",
    "ServiceUnreachable",
    "Verdict",
    "VersionChange",
    "VersionInfo",
    "VersionWatch",
    "ZenohClient",
]

_HOME = {
    "AsyncClient": ".async_client",
    "BuildStatus": ".records",
    "Client": ".client",
    "DescriptorParameters": "firstfix.scan.descriptor_parameters",
    "FirstfixError": "firstfix.errors",
    "HedgePolicy": ".policies",
    "Hypothesis": "firstfix.answer.localization",
    "Localization": "firstfix.answer.localization",
    "LocalizeOptions": "firstfix.answer.options",
    "MapInfo": ".records",
    "Prior": "firstfix.answer.prior",
    "Reason": "firstfix.answer.localization",
    "ReplicaInfo": ".records",
    "RetryPolicy": ".policies",
    "Scan": "firstfix.scan.scan",
    "ScanSequence": "firstfix.scan.sequence",
    "ServiceUnreachable": ".errors",
    "Verdict": "firstfix.answer.localization",
    "VersionChange": ".version_watch",
    "VersionInfo": ".records",
    "VersionWatch": ".version_watch",
    "ZenohClient": ".zenoh_client",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(_HOME[name], __name__), name)
    return value


def __dir__() -> list[str]:
    return list(__all__)
