from __future__ import annotations

import numpy as np
import pytest

from firstfix.errors import MalformedData, NotFound
from firstfix.transform import from_quaternion, quaternion_of
from firstfix_builder.sources.read_map import read_trajectory

RNG = np.random.default_rng(9)
POSES = np.stack([from_quaternion(RNG.uniform(-9, 9, 3), RNG.normal(size=4)) for _ in range(5)])
T = POSES[:, :3, 3]
Q = np.stack([quaternion_of(pose) for pose in POSES])


def rows(array, separator=" ", digits=9):
    return "\n".join(separator.join(f"{v:.{digits}f}" for v in row) for row in array) + "\n"


NAMES = "scan,tx,ty,tz,qx,qy,qz,qw,note\n"
FILES = {
    "tum.txt": rows(np.c_[np.arange(5) + 1.6e9, T, Q]),
    "tum.csv": "# stamp, x, y, z, qx, qy, qz, qw\n" + rows(np.c_[np.arange(5), T, Q], ","),
    "coarse.txt": rows(np.c_[np.arange(5), T, Q], digits=4),
    "kitti.txt": rows(POSES[:, :3].reshape(5, 12)),
    "matrices.txt": rows(POSES.reshape(5, 16)),
    "named.csv": NAMES + "".join(f"a.pcd,{row},n o t e\n" for row in rows(np.c_[T, Q], ",").splitlines()),
    "poses.txt": rows(np.c_[T, Q]),
    "key_frame.txt": rows(np.c_[Q, T]),
    "livox_like.txt": rows(np.c_[Q, T]),
    "pose.json": rows(np.c_[T, Q[:, 3], Q[:, :3]]),
}


@pytest.mark.parametrize("name", FILES)
def test_every_form_of_a_trajectory_is_read(tmp_path, name):
    (tmp_path / name).write_text(FILES[name])
    poses = read_trajectory(tmp_path / name)
    np.testing.assert_allclose(poses, POSES, atol=3e-4 if "coarse" in name else 1e-6)


def test_a_single_matrix_is_one_pose(tmp_path):
    for size in (3, 4):
        (tmp_path / "a.txt").write_text(rows(POSES[0, :size]))
        np.testing.assert_allclose(read_trajectory(tmp_path / "a.txt"), POSES[:1], atol=1e-8)


def test_rows_without_a_pose_are_left_out(tmp_path):
    row = "a,1,2,3,0,0,0,1,\n"
    (tmp_path / "a.csv").write_text(NAMES + row + "b,,,,,,,,\n" + row)
    assert len(read_trajectory(tmp_path / "a.csv")) == 2
    (tmp_path / "a.csv").write_text(NAMES + "b,,,,,,,,\n")
    with pytest.raises(MalformedData, match="no pose"):
        read_trajectory(tmp_path / "a.csv")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "empty"),
        ("  \n\n", "empty"),
        ("# only a comment\n", "no pose"),
        ("1 2 3\n", "rows of 3 numbers"),
        ("0 1 2 3 0 0 0 1\n0 1 2 3 0 0 1\n", "7 numbers, the rows before have 8"),
        ("0 1 2 3 0 0 0 0\n", "not of length 1"),
        ("0 1 2 3 4 5 6 7\n", "not of length 1"),
        ("0 nan 2 3 0 0 0 1\n", "pose 1 .* not finite"),
        ("0 1 2 3 0 0 0 1\n0 1 inf 3 0 0 0 1\n", "pose 2 .* not finite"),
        ("0 1 2 3 0 0 0 1\nfoo\n", "."),
        ("2 0 0 0 0 2 0 0 0 0 2 0\n", "not a rigid transform"),
        ("1 0 0 0 0 1 0 0 0 0 -1 0\n", "not a rigid transform"),
        ("1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 2\n", "not a rigid transform"),
        ("\0\1\2\3", "not text"),
        (NAMES + "a,1,2,3,0,0,0,one,\n", "row 1"),
        (NAMES + "a,1,2,3,0,0,0\n", "row 1"),
    ],
)
def test_a_malformed_trajectory_is_named(tmp_path, text, reason):
    (tmp_path / "poses.txt").write_text(text)
    with pytest.raises(MalformedData, match=rf"^poses\.txt: .*{reason}"):
        read_trajectory(tmp_path / "poses.txt")


def test_a_missing_trajectory_is_not_found(tmp_path):
    with pytest.raises(NotFound, match=r"absent\.txt"):
        read_trajectory(tmp_path / "absent.txt")
