#!/usr/bin/env bash
# pyoctomap: extractPointCloud gives points half a voxel off, in x, y and z.
#
# Version: pyoctomap 1.2.2 (Python 3.11), numpy 2.4.6.
# Behaviour: a voxel is occupied at (0.05, 0.05, 0.05) in a tree of 0.1 m. The iterator over the leaves and OctoMap
# itself say that its middle is there. OcTree.extractPointCloud() returns (0.1, 0.1, 0.1): a corner of the voxel.
# Who makes a map of it has one that is off by half a voxel, 0.09 m at 0.1 m, along the diagonal.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pyoctomap==1.2.2 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import numpy as np
import pyoctomap

tree = pyoctomap.OcTree(0.1)
tree.updateNode(np.array([0.05, 0.05, 0.05]), True)
(middle,) = [leaf.getCoordinate() for leaf in tree.begin_leafs()]
(extracted,), _ = tree.extractPointCloud()
print("middle of the leaf:", np.round(middle, 3).tolist(), "extracted:", np.round(extracted, 3).tolist())
assert np.allclose(middle, 0.05, atol=1e-6), "the leaf has another middle"
assert np.allclose(extracted, 0.1, atol=1e-6), "another point: the behaviour has changed"
PYTHON
# Output seen:
#   middle of the leaf: [0.05, 0.05, 0.05] extracted: [0.1, 0.1, 0.1]
echo "as described"
