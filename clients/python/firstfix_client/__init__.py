"""What runs on the robot: ask for a fix, get a typed answer.

    from firstfix_client import Client

    with Client("http://localhost:8080") as client:
        fix = client.localize(points, map_id="hall")
    if fix.T_map_sensor is not None:
        ...

``ZenohClient`` asks the same over zenoh (extra ``firstfix[zenoh]``).
"""

from firstfix.localization import Localization, Verdict
from firstfix.options import LocalizeOptions
from firstfix.prior import Prior
from firstfix.query_parameters import QueryParameters
from firstfix.scan import Scan
from firstfix.scan_sequence import ScanSequence

from .client import Client
from .errors import ServiceUnreachable
from .records import BuildStatus, MapInfo, VersionInfo
from .replica_info import ReplicaInfo
from .retry import RetryPolicy
from .version_watch import VersionChange, VersionWatch
from .zenoh_client import ZenohClient

__all__ = [
    "BuildStatus",
    "Client",
    "Localization",
    "LocalizeOptions",
    "MapInfo",
    "Prior",
    "ReplicaInfo",
    "QueryParameters",
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
