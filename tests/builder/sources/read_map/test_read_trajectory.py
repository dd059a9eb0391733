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


def with_time(columns, separator=" "):
    return rows(np.c_[np.arange(5) + 100.0, columns], separator)


def g2o(order):
    vertices = [f"VERTEX_SE3:QUAT {n} {rows(np.c_[T, Q][n : n + 1])}" for n in order]
    return "".join(vertices) + "FIX 0\nVERTEX_TRACKXYZ 7 1 2 3\nEDGE_SE3:QUAT 0 1 1 0 0 0 0 0 1 1\n"


# Basalt's EuRoC output (basalt-mirror src/vio.cpp) and the ground truth of EuRoC and TUM-VI: w first
BASALT = "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []\n"
EUROC = BASALT.strip() + ",v_RS_R_x [m s^-1],v_RS_R_y [m s^-1],v_RS_R_z [m s^-1],b_w_RS_S_x [rad s^-1]\n"
W_FIRST = np.c_[T, Q[:, 3], Q[:, :3]]
RTABMAP = "#timestamp x y z qx qy qz qw id\n"  # rtabmap-export, --poses_format 11 (0.21, its default)
NAMES = "scan,tx,ty,tz,qx,qy,qz,qw,note\n"
FILES = {
    "tum.txt": rows(np.c_[np.arange(5) + 1.6e9, T, Q]),
    "tum.csv": "# stamp, x, y, z, qx, qy, qz, qw\n" + rows(np.c_[np.arange(5), T, Q], ","),
    "coarse.txt": rows(np.c_[np.arange(5), T, Q], digits=4),
    "kitti.txt": rows(POSES[:, :3].reshape(5, 12)),
    "matrices.txt": rows(POSES.reshape(5, 16)),
    "named.csv": NAMES + "".join(f"a.pcd,{row},n o t e\n" for row in rows(np.c_[T, Q], ",").splitlines()),
    "ids_are_names.csv": "id,x,y,z,qx,qy,qz,qw\n"
    + "".join(f"a.pcd,{row}\n" for row in rows(np.c_[T, Q], ",").splitlines()),
    "landmarks.csv": "id,x,y,z,qx,qy,qz,qw\n"
    + "".join(f"{n},{row}\n" for n, row in enumerate(rows(np.c_[T, Q], ",").splitlines()))
    + "-4,1,2,3,0,0,0,1\n",
    "poses.txt": rows(np.c_[T, Q]),
    "key_frame.txt": rows(np.c_[Q, T]),
    "livox_like.txt": rows(np.c_[Q, T]),
    "pose.json": rows(np.c_[T, Q[:, 3], Q[:, :3]]),
    "basalt.csv": BASALT + with_time(W_FIRST, ","),
    "euroc.csv": EUROC + with_time(np.c_[W_FIRST, np.ones((5, 4))], ","),
    "w_first.txt": "# timestamp x y z qw qx qy qz\n" + with_time(W_FIRST),
    "format.txt": "# format: timestamp x y z qx qy qz qw\n" + with_time(np.c_[T, Q]),
    "tum_named.txt": "# ground truth\n# timestamp tx ty tz qx qy qz qw\n" + with_time(np.c_[T, Q]),
    "rtabmap.txt": RTABMAP + with_time(np.c_[T, Q, 1:6]) + "0 1 2 3 0 0 0 1 -12\n",
    "rtabmap_unnamed.txt": with_time(np.c_[T, Q, 1:6]),
    "newer_college.csv": "#sec,nsec,x,y,z,qx,qy,qz,qw\n" + with_time(np.c_[7:12, T, Q], ","),
    "newer_college_unnamed.csv": with_time(np.c_[70:75, T, Q], ","),
    "plain_names.csv": "x,y,z,qx,qy,qz,qw\n" + rows(np.c_[T, Q], ","),
    "plain_names.txt": "qw qx qy qz tx ty tz\n" + rows(np.c_[Q[:, 3], Q[:, :3], T]),
    "topic.csv": (  # rostopic echo -p
        "%time,field.pose.position.x,field.pose.position.y,field.pose.position.z,field.pose.orientation.x,"
        "field.pose.orientation.y,field.pose.orientation.z,field.pose.orientation.w,field.twist.linear.x\n"
        + with_time(np.c_[T, Q, np.ones(5)], ",")
    ),
    "hdmapping.csv": (  # trajectory_lio_0.csv of HDMapping 0.9x
        "timestamp_nanoseconds "
        + " ".join(f"pose{r}{c}" for r in range(3) for c in range(4))
        + " om_rad\n"
        + with_time(np.c_[POSES[:, :3].reshape(5, 12), np.zeros(5)])
    ),
    "named_in_its_own_language.csv": "Größe,"
    + NAMES
    + "".join(f"1,a.pcd,{row},\n" for row in rows(np.c_[T, Q], ",").splitlines()),
    "commented_table.csv": NAMES
    + "# the first part\n"
    + "".join(f"a.pcd,{row},\n" for row in rows(np.c_[T, Q], ",").splitlines())
    + "# end of file\n",
    "commented.txt": "# Größe\n% and more\n" + with_time(np.c_[T, Q]) + "# end\n",
    "stamped_topic.csv": (  # rostopic echo -p of a PoseStamped
        "%time,field.header.frame_id,field.pose.position.x,field.pose.position.y,field.pose.position.z,"
        "field.pose.orientation.x,field.pose.orientation.y,field.pose.orientation.z,field.pose.orientation.w\n"
        + "".join(f"1,map,{row}\n" for row in rows(np.c_[T, Q], ",").splitlines())
    ),
    "named_scans.txt": "# scan x y z qx qy qz qw\n"
    + "".join(f"{n}.pcd {row}\n" for n, row in enumerate(rows(np.c_[T, Q]).splitlines())),
    "percent.txt": "% timestamp x y z qw qx qy qz\n" + with_time(W_FIRST),
    "slashes.txt": "// timestamp x y z qw qx qy qz\n" + with_time(W_FIRST),
    "format_w_first.txt": "# format: timestamp x y z qw qx qy qz\n" + with_time(W_FIRST),
    "windows.txt": "\ufefftimestamp\tx\ty\tz\tqw\tqx\tqy\tqz\r\n"
    + with_time(W_FIRST, "\t").replace("\n", "\r\n"),
    "kitti360.txt": rows(np.c_[np.arange(5) + 3, POSES[:, :3].reshape(5, 12)]),
    "kitti360_4x4.txt": rows(np.c_[np.arange(5) + 3, POSES.reshape(5, 16)]),
    "graph.g2o": g2o((0, 1, 2, 3, 4)),
    "unordered.g2o": g2o((3, 0, 4, 2, 1)),
    "g2o.txt": g2o((0, 1, 2, 3, 4)),
}


@pytest.mark.parametrize("name", FILES)
def test_every_form_of_a_trajectory_is_read(tmp_path, name):
    (tmp_path / name).write_bytes(FILES[name].encode())
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
        ("1326030975726043,0,0,0,0,0,1\n", "the number 1.32603e.15, which is no length .* is it a time"),
        ("t,lat,lon\n1,2,3\n", "'t,lat,lon', the line of names, does not name tx, ty"),
        ("# t x y z qw qx qy qz id\n0 1 2 3 1 0 0 0\n", "a comment names 9 columns, .* have 8"),
        ("# t x y z\n# qw qx qy qz\n0 1 2 3 1 0 0 0\n", "a comment says that w is .* first"),
        ("# time, position, quaternion (wxyz)\n0 1 2 3 1 0 0 0\n", "a comment says that w is .* first"),
        ("t,x,y,z,qx,qy,qz,qw\n0 1 2 3 0 0 0 1\n", "the line of names has ',' between .* no row has"),
        ("t x y z qx qy qz qw\n0,1,2,3,0,0,0,1\n", "the line of names has spaces between .* no row has"),
        (RTABMAP + "0 1 2 3 0 0 0 1 -12\n", "no pose"),
        ("VERTEX_SE3:QUAT 0 1 2 3\n", "with 4 numbers instead of 8"),
    ],
)
def test_a_malformed_trajectory_is_named(tmp_path, text, reason):
    (tmp_path / "poses.txt").write_text(text)
    with pytest.raises(MalformedData, match=rf"^poses\.txt: .*{reason}"):
        read_trajectory(tmp_path / "poses.txt")


def test_a_missing_trajectory_is_not_found(tmp_path):
    with pytest.raises(NotFound, match=r"absent\.txt"):
        read_trajectory(tmp_path / "absent.txt")


@pytest.mark.timeout(60)  # not a measurement: what it guards against takes hours
@pytest.mark.parametrize("comment", ["w{0}x{0}y{0}".format(" " * 20_000), "(" * 60_000, "[" * 60_000])
def test_a_long_comment_takes_no_time(tmp_path, comment):
    (tmp_path / "a.txt").write_text(f"# {comment}\n" + with_time(np.c_[T, Q]))
    np.testing.assert_allclose(read_trajectory(tmp_path / "a.txt"), POSES, atol=1e-6)
