#!/usr/bin/env bash
# open3d-cpu: the wheel links libidn2.so.0 of the system, does not bundle it, and has a manylinux tag.
#
# Version: open3d-cpu 0.20.0 (Python 3.11, x86-64), read with pyelftools 0.32.
# Behaviour: the tag manylinux_2_35 promises to need nothing of the system but a list of libraries that every Linux has
# (PEP 600); libidn2, libEGL, libGL, libudev and libusb-1.0 are not bundled and libOpen3D names them all. Debian 12's smallest
# image has libidn2 by chance (apt needs it there), Debian 13's has not: after `apt-get install libgl1 libegl1 libx11-6 libudev1
# libusb-1.0-0 libgomp1`, which is enough on Debian 12, `import open3d` fails on Debian 13 with "libidn2.so.0: cannot open shared
# object file". `apt-get install libidn2-0` mends it.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
pip=("$folder/venv/bin/pip" --quiet --disable-pip-version-check)
"${pip[@]}" install pyelftools==0.32
"${pip[@]}" download --no-deps --only-binary :all: --platform manylinux_2_35_x86_64 --python-version 3.11 --dest "$folder" open3d-cpu==0.20.0
"$folder/venv/bin/python" - "$folder" <<'PYTHON'
import io
import sys
import zipfile
from pathlib import Path

from elftools.elf.elffile import ELFFile

(wheel,) = Path(sys.argv[1]).glob("open3d_cpu-*.whl")
with zipfile.ZipFile(wheel) as files:
    names = files.namelist()
    (library,) = [name for name in names if "libOpen3D.so" in name]
    elf = ELFFile(io.BytesIO(files.read(library)))
needed = {tag.needed for tag in elf.get_section_by_name(".dynamic").iter_tags("DT_NEEDED")}
bundled = {Path(name).name for name in names}
asked = sorted(name for name in needed - bundled if name.startswith(("libidn2", "libEGL", "libGL", "libudev", "libusb")))
print("tag:", wheel.stem.split("-")[-1], "- asked of the system:", " ".join(asked))
assert "manylinux" in wheel.name and "libidn2.so.0" in asked, "the behaviour has changed"
PYTHON
# Output seen:
#   tag: manylinux_2_35_x86_64 - asked of the system: libEGL.so.1 libGL.so.1 libidn2.so.0 libudev.so.1 libusb-1.0.so.0
echo "as described"
