from __future__ import annotations

import json

import numpy as np
import pytest

from firstfix.errors import MalformedData, NotFound, TooLarge
from firstfix_builder.sources.sessions.description import MAX_SESSIONS, description_in, read_description

TURNED = [[0, -1, 0, 5], [1, 0, 0, -2], [0, 0, 1, 0.5], [0, 0, 0, 1]]


def write(folder, sessions, name="sessions.yaml"):
    for session in sessions:
        if isinstance(session, dict) and isinstance(session.get("source"), str):
            (folder / session["source"].strip("/").replace("..", "up")).parent.mkdir(
                parents=True, exist_ok=True
            )
            (folder / session["source"].strip("/").replace("..", "up")).write_bytes(b"x")
    path = folder / name
    path.write_text(json.dumps({"sessions": sessions}))
    return path


def test_sessions_are_read_in_order(tmp_path):
    (tmp_path / "poses.txt").write_text("x")
    path = write(
        tmp_path,
        [
            {"source": "monday/map.pcd"},
            {"source": "tuesday.laz", "trajectory": "poses.txt", "T_map_session": TURNED},
            {"source": "wednesday.laz", "align": True},
        ],
    )
    assert description_in(tmp_path) == path
    first, second, third = read_description(path)
    assert (first.source, first.given, second.trajectory) == ("monday/map.pcd", None, "poses.txt")
    np.testing.assert_allclose(second.given, TURNED)
    assert third.given is None


def test_a_folder_without_the_file_is_one_map(tmp_path):
    assert description_in(tmp_path) is None


@pytest.mark.parametrize(
    ("session", "why"),
    [
        ({"source": "../map.pcd"}, "not a path below the folder"),
        ({"source": "/etc/passwd"}, "not a path below the folder"),
        ({"source": "a\\b.pcd"}, "not a path below the folder"),
        ({"source": "."}, "not a path below the folder"),
        ({"source": ".cache/map.pcd"}, "not a path below the folder"),
        ({"source": "map.pcd", "trajectory": "../poses.txt"}, "not a path below the folder"),
        ({"source": "x" * 300}, "at most 200"),
        ({"source": "map.pcd", "align": False}, "needs T_map_session"),
        ({"source": "map.pcd", "align": True, "T_map_session": TURNED}, "either"),
        ({"source": "map.pcd", "T_map_session": TURNED[:3]}, "at least 4"),
        ({"source": "map.pcd", "T_map_session": [[2, 0, 0, 0], *TURNED[1:]]}, "not a rigid transform"),
        ({"source": "map.pcd", "T_map_session": [["nan", 0, 0, 0], *TURNED[1:]]}, "not a rigid transform"),
        ({"source": "map.pcd", "weight": 2}, "weight"),
        ({}, "source"),
        ("map.pcd", "sessions"),
    ],
)
def test_a_wrong_session_is_named(tmp_path, session, why):
    path = tmp_path / "sessions.yaml"
    (tmp_path / "map.pcd").write_bytes(b"x")
    path.write_text(json.dumps({"sessions": [session]}))
    with pytest.raises(MalformedData, match=why):
        read_description(path)


@pytest.mark.parametrize(
    "text", ["", "[]", "sessions: []", "sessions: [", "{sessions: {}}", "a: &a [*a]", "\x00"]
)
def test_a_description_without_sessions_is_malformed(tmp_path, text):
    path = tmp_path / "sessions.yaml"
    path.write_text(text)
    with pytest.raises(MalformedData, match=r"sessions\.yaml"):
        read_description(path)


def test_descriptions_beyond_the_limits_are_refused(tmp_path):
    with pytest.raises(MalformedData, match=f"at most {MAX_SESSIONS}"):
        read_description(write(tmp_path, [{"source": f"{n}.pcd"} for n in range(MAX_SESSIONS + 1)]))
    with pytest.raises(MalformedData, match="same source"):
        read_description(write(tmp_path, [{"source": "a.pcd"}, {"source": "./a.pcd"}]))
    (tmp_path / "sessions.yaml").write_bytes(b"#" * 70_000)
    with pytest.raises(TooLarge):
        read_description(tmp_path / "sessions.yaml")


def test_a_link_does_not_lead_out_of_the_folder(tmp_path):
    (tmp_path / "secret.pcd").write_bytes(b"x")
    folder = tmp_path / "maps"
    folder.mkdir()
    (folder / "map.pcd").symlink_to(tmp_path / "secret.pcd")
    (folder / "sessions.json").write_text(json.dumps({"sessions": [{"source": "map.pcd"}]}))
    with pytest.raises(MalformedData, match="leads out of the folder"):
        read_description(folder / "sessions.json")


def test_a_missing_session_is_not_found(tmp_path):
    (tmp_path / "sessions.json").write_text(json.dumps({"sessions": [{"source": "map.pcd"}]}))
    with pytest.raises(NotFound, match=r"map\.pcd"):
        read_description(tmp_path / "sessions.json")
