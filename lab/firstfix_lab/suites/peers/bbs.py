"""3D-BBS (Aoki et al., ICRA 2024, its own C++ on the CPU), then GICP.

It has the true direction of gravity, which its search needs. The parameters are those of its own
``test.yaml`` (levels: 1 m outdoors, 0.5 m indoors). Its confidence is the share of points in occupied voxels;
0.9 is accepted, as there. It searches down to 0.8: a scan that sees things the map lacks may not reach more.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.scan.levelling import levelling_rotation
from firstfix.scan.reduction import voxel_means
from firstfix.scan.scan import Scan
from firstfix.transform import Matrix, make_transform

from .answer import Answer
from .icp import Gicp
from .peer_input import PeerInput
from .prior import Prior
from .sent import points_bytes

SOURCE = Path(__file__).with_name("bbs_driver.cpp")
LIBRARY, HEADER = Path("lib", "libcpu_bbs3d.so"), Path("include", "cpu_bbs3d", "bbs3d.hpp")
EIGEN = Path("/usr/include/eigen3")
DOUBLINGS = 6
SEARCHED_SHARE, ACCEPTED_SHARE = 0.8, 0.9
LIMIT_S = 40.0
MAP_VOXEL_M = 0.1
SCAN_VOXEL_M = 2.0
GICP_REACH_M = 1.0
REPLY_BYTES = 17 * 8


def why_not(prefix: Path | None) -> str | None:
    """Why 3D-BBS cannot be asked, or None.

    Args:
        prefix: where it is installed.
    """
    if prefix is None:
        return "no --bbs PREFIX says where 3D-BBS is installed"
    if absent := [str(path) for path in (LIBRARY, HEADER) if not (prefix / path).exists()]:
        return f"{prefix} has no {' and no '.join(absent)}"
    if shutil.which("g++") is None or not EIGEN.exists():
        return "no g++ or no Eigen here"
    return None


def build_driver(prefix: Path, work: Path) -> Path:
    """Compiles ``bbs_driver.cpp`` against the installed library.

    Args:
        work: an existing folder.

    Raises:
        CalledProcessError: it does not compile.
    """
    driver = work / "bbs_driver"
    command = ["g++", "-O2", "-std=c++17", str(SOURCE), "-o", str(driver)]
    command += ["-isystem", str(prefix / "include"), "-isystem", str(EIGEN)]
    library = (prefix / LIBRARY).resolve()
    # The library leaves Boost to the programs that use it.
    subprocess.run([*command, str(library), f"-Wl,-rpath,{library.parent}", "-lboost_filesystem"], check=True)
    return driver


class Bbs:
    sent_bytes = staticmethod(points_bytes)

    def __init__(self, given: PeerInput) -> None:
        assert given.bbs_driver is not None
        points = given.map_points()
        self._given = given
        thinned = given.work / "bbs_map.f64"
        voxel_means(points, MAP_VOXEL_M).astype("<f8").tofile(thinned)
        limit_ms, threads = str(round(1e3 * LIMIT_S)), str(os.cpu_count() or 1)
        arguments = [
            str(thinned),
            str(given.bbs_level_m),
            str(DOUBLINGS),
            str(SEARCHED_SHARE),
            limit_ms,
            threads,
        ]
        self._driver = subprocess.Popen(
            [str(given.bbs_driver), *arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        assert self._driver.stdin is not None
        assert self._driver.stdout is not None
        self._to, self._from = self._driver.stdin, self._driver.stdout
        if self._from.readline() != b"ready\n":
            raise RuntimeError("bbs_driver did not start: see above")
        self._gicp = Gicp(points, GICP_REACH_M)

    def __call__(self, scan: Scan, prior: Prior) -> Answer:
        points = self._given.cropped(scan)
        T_level_sensor = make_transform(levelling_rotation(-prior.gravity), np.zeros(3))
        share, T_map_level = self._search(points @ T_level_sensor[:3, :3].T)
        if share == 0:
            return Answer()
        T_map_sensor = self._gicp.refine(points, T_map_level @ T_level_sensor)
        return Answer(T_map_sensor, share, share >= ACCEPTED_SHARE)

    def close(self) -> None:
        """End the driver, which reads until its input ends."""
        self._to.close()
        self._from.close()
        self._driver.wait()

    def _search(self, points: NDArray[np.float64]) -> tuple[float, Matrix]:
        """The share of points in occupied voxels, 0 if nothing was found, and T_map_level."""
        thinned = voxel_means(points, SCAN_VOXEL_M)
        self._to.write(np.uint64(len(thinned)).tobytes() + thinned.astype("<f8").tobytes())
        self._to.flush()
        reply = self._from.read(REPLY_BYTES)
        if len(reply) < REPLY_BYTES:
            raise RuntimeError("bbs_driver ended: see above")
        share, *pose = np.frombuffer(reply, "<f8")
        return float(share), np.reshape(pose, (4, 4))
