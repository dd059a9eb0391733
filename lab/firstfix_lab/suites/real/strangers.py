"""Real road scans of other places, asked of a map: none may be localized."""

from __future__ import annotations

import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from firstfix.answer.localization import Verdict
from firstfix.engine.localizer import Localizer
from firstfix.scan_file import read_scan_file
from tests.recorded_data import SHARED

FOLDER = SHARED / "strangers"


def ask_strangers(localizer: Localizer, folder: Path = FOLDER) -> dict[str, Any]:
    """Ask each scan of the folder. Returns their number, the verdicts, the localized ones and the time."""
    localized, verdicts, ms = [], Counter[str](), []
    for path in sorted(folder.glob("*.pcd")):
        scan, began = read_scan_file(path), time.perf_counter()
        answer = localizer.localize(scan)
        ms.append(1e3 * (time.perf_counter() - began))
        verdicts[answer.verdict.value] += 1
        if answer.verdict is Verdict.LOCALIZED:
            localized.append(path.name)
    middle = round(float(np.median(ms)), 1) if ms else None
    return {"n": len(ms), "verdicts": dict(verdicts), "localized": localized, "ms_p50": middle}
