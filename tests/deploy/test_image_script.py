"""deploy/image/build.sh: it shows how far the engine is."""

from __future__ import annotations

import subprocess
from pathlib import Path

SCRIPT = Path(__file__).resolve().parents[2] / "deploy/image/build.sh"


def test_the_lines_of_the_engine_are_shown(tmp_path: Path):
    engine = tmp_path / "docker"
    engine.write_text('#!/bin/sh\ncase " $* " in *" --quiet "*) ;; *" build "*) echo "Step 1/9" ;; esac\n')
    engine.chmod(0o755)
    environment = {"PATH": f"{tmp_path}:/usr/bin:/bin", "TARGETS": "service"}
    done = subprocess.run([SCRIPT], env=environment, capture_output=True, text=True, check=True)
    assert "Step 1/9" in done.stderr
