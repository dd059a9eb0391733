"""What runs on the robot: ask for a fix, get a typed answer.

    from firstfix_client import Client

    with Client("http://localhost:8080") as client:
        fix = client.localize(points, map_id="hall")
    if fix.T_map_sensor is not None:
        ...

``AsyncClient`` does the same for asyncio, ``ZenohClient`` over zenoh (with eclipse-zenoh installed).
The names here are loaded when they are used first: a robot's program starts no slower for what it leaves.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from firstfix.answer.localization import Localization, Verdict
    from firstfix.answer.options import LocalizeOptions
    from firstfix.answer.prior import Prior
    from firstfix.scan.descriptor_parameters import DescriptorParameters
    from firstfix.scan.scan import Scan
    from firstfix.scan.sequence import ScanSequence

    from .async_client import AsyncClient
    from .client import Client
    from .errors import ServiceUnreachable
    from .hedge import HedgePolicy
    from .records import BuildStatus, MapInfo, VersionInfo
    from .replica_info import ReplicaInfo
    from .retry import RetryPolicy
    from .version_watch import VersionChange, VersionWatch
    from .zenoh_client import ZenohClient

__all__ = [
    "AsyncClient",
    "BuildStatus",
    "Client",
    "HedgePolicy",
    "Localization",
    "LocalizeOptions",
    "MapInfo",
    "Prior",
    "DescriptorParameters",
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
    "HedgePolicy": ".hedge",
    "Localization": "firstfix.answer.localization",
    "LocalizeOptions": "firstfix.answer.options",
    "MapInfo": ".records",
    "Prior": "firstfix.answer.prior",
    "DescriptorParameters": "firstfix.scan.descriptor_parameters",
    "ReplicaInfo": ".replica_info",
    "RetryPolicy": ".retry",
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
    return sorted({*globals(), *__all__})
