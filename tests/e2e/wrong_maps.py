"""Wrong maps and commands, each made from a right map: what users give by mistake."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.bit_exact.sample import rows_by_chance

Points = NDArray[np.float64]
UTM = np.array([450_000.0, 5_200_000.0, 300.0])
POSES = "poses.txt"


@dataclass(frozen=True)
class WrongMap:
    """One wrong map or command.

    Attributes:
        name: what is wrong.
        arguments: of the command line; FILE stands for the path of ``file``, STORE for an empty store.
        file: name of the file that is made; empty: none is.
        content: bytes of the file.
    """

    name: str
    arguments: tuple[str, ...] = ("check", "FILE")
    file: str = "map.npy"
    content: Callable[[Points], bytes] = lambda right: b""


def npy(points: NDArray[np.floating]) -> bytes:
    out = io.BytesIO()
    np.save(out, points)
    return out.getvalue()


def turned_again(right: Points) -> Points:
    """The map with its larger half again, turned by 1 degree and shifted by 0.5 m."""
    half = right[right[:, 0] > np.median(right[:, 0])]
    turn, centre = np.radians(1.0), half.mean(axis=0)
    R = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    return np.concatenate([right, (half - centre) @ R.T + centre + [0.4, 0.3, 0.0]])


def text(points: Points, separator: str, decimal: str = ".") -> bytes:
    rows = (separator.join(f"{v:.3f}".replace(".", decimal) for v in row) for row in points[:1000])
    return ("\n".join(rows) + "\n").encode()


def pcd(points: Points) -> bytes:
    head = (
        "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
        f"WIDTH {len(points)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(points)}\nDATA binary\n"
    )
    return head.encode() + points.astype("<f4").tobytes()


def _build(*options: str, file: str = "map.npy") -> tuple[str, ...]:
    return ("build", "FILE", "--map-id", "yard", "--store", "STORE", *options)


PNG = b"\x89PNG\r\n\x1a\n" + bytes(64)
WRONG_MAPS = (
    WrongMap("in millimetres", content=lambda right: npy(1000 * right)),
    WrongMap("in centimetres", content=lambda right: npy(100 * right)),
    WrongMap("a hundred times too small", content=lambda right: npy(right / 100)),
    WrongMap("in kilometres", content=lambda right: npy(right / 1000)),
    WrongMap("UTM coordinates in float32", content=lambda right: npy((right + UTM).astype(np.float32))),
    WrongMap("y points up", content=lambda right: npy(right[:, [1, 2, 0]])),
    WrongMap("103 points", content=lambda right: npy(right[:103])),
    WrongMap("300 points, metres apart", content=lambda right: npy(5 * right[:300])),
    WrongMap("the floor alone", content=lambda right: npy(right[np.abs(right[:, 2]) < 0.12])),
    WrongMap("walls doubled by a loop that was not closed", content=lambda right: npy(turned_again(right))),
    WrongMap(
        "the cloud as its trajectory",
        ("check", "FILE", "--trajectory", "FILE"),
        "map.pcd",
        lambda right: pcd(right[rows_by_chance(len(right), len(right) // 20)]),
    ),
    WrongMap(
        "a trajectory of another map",
        ("check", "FILE", "--trajectory", POSES),
        content=npy,
    ),
    WrongMap("all NaN", content=lambda right: npy(np.full((1000, 3), np.nan))),
    WrongMap("an array (3, n)", content=lambda right: npy(right.T)),
    WrongMap("an archive .npz named .npy", content=lambda right: b"PK\x03\x04" + bytes(64)),
    WrongMap("a PNG image named .pcd", file="map.pcd", content=lambda right: PNG),
    WrongMap("text named .ply", file="map.ply", content=lambda right: text(right, " ")),
    WrongMap("a PLY file named .laz", file="map.laz", content=lambda right: b"ply\nformat ascii 1.0\n"),
    WrongMap("a PCD file that is cut off", file="map.pcd", content=lambda right: pcd(right)[:9999]),
    WrongMap("an empty file", file="map.ply"),
    WrongMap("decimal commas", file="map.csv", content=lambda right: text(right, ";", ",")),
    WrongMap("commas in an ascii PCD", file="map.pcd", content=lambda right: _ascii_pcd(text(right, ","))),
    WrongMap("a ROS 1 bag", file="map.bag", content=lambda right: b"#ROSBAG V2.0\n"),
    WrongMap("a folder without a map", ("check", "FOLDER"), file=""),
    WrongMap("a file that is not there", ("check", "/no/map.pcd"), file=""),
    WrongMap("a sensor vlp16", _build("--sensor", "vlp16"), content=npy),
    WrongMap("a map id F8", ("build", "FILE", "--map-id", "F8", "--store", "STORE"), content=npy),
    WrongMap("a scale of 0", _build("--scale", "0"), content=npy),
    WrongMap("no store to serve", ("serve",), file=""),
)


def _ascii_pcd(rows: bytes) -> bytes:
    return pcd(np.zeros((1000, 3))).split(b"DATA")[0] + b"DATA ascii\n" + rows


def written(wrong: WrongMap, right: Points, folder: Path) -> list[str]:
    """Writes the files of a wrong map. Returns the arguments of its command."""
    folder.mkdir()
    if wrong.file:
        (folder / wrong.file).write_bytes(wrong.content(right))
    (folder / "empty").mkdir()
    rows = (f"{k} {500 + 0.1 * k} 0 1 0 0 0 1" for k in range(50))
    (folder / POSES).write_text("\n".join(rows))
    names = {
        "FILE": str(folder / wrong.file),
        "FOLDER": str(folder / "empty"),
        "STORE": str(folder / "store"),
        POSES: str(folder / POSES),
    }
    return [names.get(argument, argument) for argument in wrong.arguments]
