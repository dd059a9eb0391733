#!/usr/bin/env bash
# DracoPy: attributes of float64 and int32 are decoded to float32, and still say that they are float64 and int32.
#
# Version: DracoPy 2.2.0 (Python 3.11).
# Behaviour: decode(...).attributes[k] has the array under "data" and Draco's type under "data_type": 10 for float64, 5 for
# int32. The array is float32 in both cases, without a word. Times of points since the epoch (1.73e9 s, a float64 field of
# Hesai's and RoboSense's PointCloud2, packed by draco_point_cloud_transport) come out in steps of 128 s: all points of a turn
# have one time. Attributes of uint32 are exact.
# Who takes "data_type" for the type of the array, or times from such a cloud, gets wrong ones.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check DracoPy==2.2.0 numpy==2.2.6
"$folder/venv/bin/python" - <<'PYTHON'
import struct

import DracoPy
import numpy as np

FLOAT32, FLOAT64, INT32, UINT32 = 9, 10, 5, 6
count = 5
fields = [  # attribute type (0 position, 4 generic), Draco's type, values
    (0, FLOAT32, np.arange(3 * count, dtype="<f4")),
    (4, FLOAT64, 1_730_000_000 + np.arange(count) * 0.02),
    (4, INT32, np.arange(count, dtype="<i4") + 100_000_001),
    (4, UINT32, np.arange(count, dtype="<u4") + 100_000_001),
]
# A point cloud of Draco 2.3: sequential, not quantised. Then of each attribute: type, number type, components, 0, id.
data = b"DRACO" + struct.pack("<BBBBHiBB", 2, 3, 0, 0, 0, count, 1, len(fields))
for number, (kind, code, values) in enumerate(fields):
    data += bytes([kind, code, len(values) // count, 0, number])
data += bytes(len(fields)) + b"".join(values.tobytes() for _, _, values in fields)

for (_, code, values), found in zip(fields, DracoPy.decode(data).attributes):
    array = found["data"].reshape(-1)
    assert found["data_type"] == code
    exact = np.array_equal(array.astype(values.dtype), values)
    print(f"data_type {code:2}: array of {array.dtype}, {'exact' if exact else f'off by up to {np.abs(array.astype(float) - values).max():g}'}")
    assert exact == (code in (FLOAT32, UINT32)), "the behaviour has changed"
    assert array.dtype == ("uint32" if code == UINT32 else "float32"), "the behaviour has changed"
PYTHON
# Output seen:
#   data_type  9: array of float32, exact
#   data_type 10: array of float32, off by up to 0.0799999
#   data_type  5: array of float32, off by up to 4
#   data_type  6: array of uint32, exact
echo "as described"
