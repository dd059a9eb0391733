"""Held-out scans of a map's folder: what is read, and what is left out with a reason."""

from pathlib import Path

import numpy as np

from firstfix.transform import make_transform, rotation_z
from firstfix_builder.sources.read_map.held_out import MAX_SCANS, HeldOut, read_held_out

HEADER = "scan,tx,ty,tz,qx,qy,qz,qw\n"
POINTS = np.arange(30, dtype=np.float32).reshape(10, 3)


def folder_of(tmp_path: Path, rows: list[str], scans: list[str], header: str = HEADER) -> Path:
    folder = tmp_path / "held_out"
    folder.mkdir()
    (folder / "poses.csv").write_text(header + "".join(f"{row}\n" for row in rows))
    for name in scans:
        np.save(folder / name, POINTS)
    return tmp_path


def test_a_folder_without_any_has_none(tmp_path):
    assert read_held_out(tmp_path, "z-up") is None
    assert HeldOut.load(tmp_path) == HeldOut()


def test_scans_are_read_moved_and_kept(tmp_path):
    source = folder_of(tmp_path, ["a.npy,1,2,3,0,0,0,1", "b.npy,4,5,6,0,0,1,0"], ["a.npy", "b.npy"])
    found = read_held_out(source, "z-up")
    assert found is not None
    assert found.reasons == {}
    T = make_transform(rotation_z(0.5), [1, 0, 0])
    found.moved(T).save(tmp_path)
    kept = HeldOut.load(tmp_path)
    assert [one.name for one in kept.scans] == ["a.npy", "b.npy"]
    for one, before in zip(kept.scans, found.scans, strict=True):
        np.testing.assert_array_equal(one.scan.points, POINTS)
        np.testing.assert_allclose(one.T_sensor, T @ before.T_sensor)
        assert one.scan.time_s is None
    np.testing.assert_allclose(found.scans[0].T_sensor, make_transform(np.eye(3), [1, 2, 3]))


def test_what_cannot_be_used_is_left_out_with_its_reason(tmp_path):
    rows = [
        "good.npy,0,0,0,0,0,0,1",
        "nowhere.npy,,,,,,,",
        "gone.npy,0,0,0,0,0,0,1",
        "bad.npy,0,0,0,0,0,0,1",
        "far.npy,nan,0,0,0,0,0,1",
        "word.npy,x,0,0,0,0,0,1",
        "turn.npy,0,0,0,0,0,0,0",
        "../out.npy,0,0,0,0,0,0,1",
        "short.npy,0,0",
        ",0,0,0,0,0,0,1",
    ]
    names = ["good.npy", "nowhere.npy", "far.npy", "word.npy", "turn.npy", "short.npy", "unnamed.npy"]
    source = folder_of(tmp_path, rows, names)
    (source / "held_out" / "bad.npy").write_bytes(b"\x93NUMPY")
    np.save(source / "out.npy", POINTS)
    found = read_held_out(source, "z-up")
    assert found is not None
    assert [one.name for one in found.scans] == ["good.npy"]
    reasons = found.reasons
    assert reasons.keys() == {
        *("nowhere.npy", "gone.npy", "bad.npy", "far.npy", "word.npy", "turn.npy", "short.npy"),
        *("../out.npy", "", "unnamed.npy"),
    }
    assert reasons["nowhere.npy"] == reasons["unnamed.npy"] == "it has no pose"
    assert reasons["gone.npy"] == "no such file"
    assert reasons["../out.npy"] == "it is not in the folder"
    assert "finite" in reasons["far.npy"]
    assert str(tmp_path) not in " ".join(reasons.values())


def test_a_damaged_file_of_poses_leaves_all_out(tmp_path):
    source = folder_of(tmp_path, ["a.npy,1,2,3"], ["a.npy"], header="scan,x,y,z\n")
    found = read_held_out(source, "z-up")
    assert found is not None
    assert not found.scans
    assert "no column tx, ty, tz" in found.reasons["held_out/poses.csv"]
    (source / "held_out" / "poses.csv").write_bytes(b"\xff\xfe\x00")
    assert read_held_out(source, "z-up").reasons.keys() == {"held_out/poses.csv"}
    (source / "held_out" / "poses.csv").unlink()
    assert "no such file" in read_held_out(source, "z-up").reasons["held_out/poses.csv"]
    assert read_held_out(source, "y-up").reasons.keys() == {"held_out"}


def test_of_many_scans_some_are_drawn_by_chance_in_their_order(tmp_path):
    count = 3 * MAX_SCANS
    names = [f"{number:03}.npy" for number in range(count)]
    source = folder_of(tmp_path, [f"{name},0,0,0,0,0,0,1" for name in names], names)
    found = read_held_out(source, "z-up")
    assert found is not None
    assert len(found.scans) == MAX_SCANS
    asked = [names.index(one.name) for one in found.scans]
    assert asked == sorted(asked)
    assert len(set(np.diff(asked))) > 2  # no stride
    assert len(found.reasons) == count - MAX_SCANS
