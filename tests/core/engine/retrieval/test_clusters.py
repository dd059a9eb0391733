"""Templates and their clusters: labels, order, files, and files that do not fit."""

from pathlib import Path

import numpy as np
import pytest

from firstfix.descriptor import LayeredOccupancy, PolarGrid
from firstfix.engine.retrieval.cascade import Clusters, Templates
from tests.every_case import every_case


def groups(clusters: Clusters) -> list[list[int]]:
    return [clusters.members(np.array([c])).tolist() for c in range(len(clusters))]


def last(rows: np.ndarray) -> int:
    return len(rows) - 1


def test_labels_become_groups_with_their_representatives():
    clusters = Clusters.from_labels(np.array([1, 0, 1, 2, 0, 1]), last)
    assert len(clusters) == 3
    assert groups(clusters) == [[1, 4], [0, 2, 5], [3]]
    assert clusters.representative.tolist() == [4, 5, 3]
    assert clusters.start.tolist() == [0, 2, 5, 6]
    assert clusters.member.tolist() == [1, 4, 0, 2, 5, 3]
    assert {array.dtype for array in vars(clusters).values()} == {np.dtype(np.int32)}


@pytest.mark.parametrize("seed", range(5))
def test_every_template_is_in_the_cluster_of_its_label(seed):
    rng = np.random.default_rng(seed)
    label = np.concatenate([np.arange(12), rng.integers(0, 12, 150)])
    rng.shuffle(label)
    clusters = Clusters.from_labels(label, lambda rows: int(rows.argmin()))
    assert groups(clusters) == [np.flatnonzero(label == c).tolist() for c in range(12)]
    assert label[clusters.representative].tolist() == list(range(12))
    assert sorted(clusters.member.tolist()) == list(range(len(label)))


def test_the_typical_template_is_asked_for_of_two_and_more():
    asked = []

    def first(rows: np.ndarray) -> int:
        asked.append(rows.tolist())
        return 0

    Clusters.from_labels(np.array([0, 1, 0, 2, 3, 3, 3]), first)
    assert asked == [[0, 2], [4, 5, 6]]


def test_members_come_in_the_order_of_the_clusters_asked_for():
    clusters = Clusters.from_labels(np.array([1, 0, 1, 2, 0, 1]), last)
    assert clusters.members(np.array([2, 0])).tolist() == [3, 1, 4]
    assert clusters.members(np.array([0, 2])).tolist() == [1, 4, 3]
    assert clusters.members(np.array([1], np.int64)).tolist() == [0, 2, 5]
    assert clusters.members(np.arange(3)).tolist() == clusters.member.tolist()


@pytest.mark.parametrize("count", [1, 2, 7])
def test_alone_is_every_template_by_itself(count):
    clusters = Clusters.alone(count)
    assert len(clusters) == count
    assert groups(clusters) == [[i] for i in range(count)]
    assert clusters.representative.tolist() == list(range(count))
    each = Clusters.from_labels(np.arange(count), last)
    for name, array in vars(clusters).items():
        assert np.array_equal(array, getattr(each, name))
        assert array.dtype == np.int32


@pytest.mark.parametrize(
    "clusters",
    [
        Clusters.from_labels(np.random.default_rng(0).permutation(np.arange(90) % 17), last),
        Clusters.from_labels(np.zeros(5, np.intp), last),
        Clusters.alone(1),
        Clusters.alone(40),
    ],
    ids=["17", "all in one", "one", "alone"],
)
def test_loaded_clusters_are_the_same(clusters, tmp_path):
    clusters.save(tmp_path)
    loaded = Clusters.load(tmp_path)
    assert len(loaded) == len(clusters)
    assert groups(loaded) == groups(clusters)
    for name, array in vars(clusters).items():
        assert np.array_equal(getattr(loaded, name), array)
        assert getattr(loaded, name).dtype == np.int32
    files = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert sorted(files) == ["cluster_member.npy", "cluster_representative.npy", "cluster_start.npy"]
    (tmp_path / "again").mkdir()
    loaded.save(tmp_path / "again")
    assert {path.name: path.read_bytes() for path in (tmp_path / "again").iterdir()} == files


def test_a_missing_file_of_clusters_is_an_error(tmp_path):
    Clusters.alone(3).save(tmp_path)
    (tmp_path / "cluster_start.npy").unlink()
    with pytest.raises(OSError, match="cluster_start"):
        Clusters.load(tmp_path)


@pytest.mark.parametrize("start", [[0, 1, 2], [0, 1, 2, 4], [1, 1, 2, 3]], ids=["few", "beyond", "late"])
def test_a_table_that_does_not_fit_is_refused(tmp_path, start):
    Clusters.alone(3).save(tmp_path)
    np.save(tmp_path / "cluster_start.npy", np.array(start, np.int32))
    with pytest.raises(ValueError, match="cluster_start"):
        Clusters.load(tmp_path)


@pytest.mark.parametrize(
    ("name", "numbers"),
    [
        ("start", [0, 2, 1, 3]),
        ("start", [0, -1, 2, 3]),
        ("member", [0, 1, 3]),
        ("member", [0, -1, 2]),
        ("representative", [0, 1, 1 << 30]),
    ],
)
def test_invalid_rows_are_refused(tmp_path, name, numbers):
    Clusters.alone(3).save(tmp_path)
    np.save(tmp_path / f"cluster_{name}.npy", np.array(numbers, np.int32))
    with pytest.raises(ValueError, match=f"cluster_{name}"):
        Clusters.load(tmp_path)


DESCRIPTOR = LayeredOccupancy(PolarGrid(2, 8, 10.0), (0.0, 1.0))


def saved_templates(directory: Path) -> Templates:
    cells = np.arange(10, dtype=np.uint8).reshape(5, 2)
    templates = Templates(np.eye(5, 3, dtype=np.float32), np.ones(5, np.float32), {"occupancy": cells})
    templates.save(directory)
    return templates


def test_loaded_templates_are_the_same(tmp_path: Path):
    templates = saved_templates(tmp_path)
    loaded = Templates.load(tmp_path, DESCRIPTOR)
    assert len(loaded) == 5
    assert np.array_equal(loaded.position_m, templates.position_m)
    assert np.array_equal(loaded.height_m, templates.height_m)
    assert np.array_equal(loaded.described["occupancy"], templates.described["occupancy"])


@every_case(
    ("name", "array"),
    [
        ("height_m", np.ones(4, np.float32)),
        ("occupancy", np.zeros((4, 2), np.uint8)),
        ("occupancy", np.zeros((6, 2), np.uint8)),
        ("height_m", np.float32(1)),
    ],
)
def test_a_file_of_templates_with_other_rows_is_refused(tmp_path: Path, name: str, array: np.ndarray):
    saved_templates(tmp_path)
    np.save(tmp_path / f"template_{name}.npy", array)
    with pytest.raises(ValueError, match=f"template_{name}.npy"):
        Templates.load(tmp_path, DESCRIPTOR)
