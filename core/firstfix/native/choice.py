"""Choice of the compiled module: the newest instruction set that the processor has."""

from __future__ import annotations

import os
from importlib import import_module
from pathlib import Path
from types import ModuleType

VARIABLE = "FIRSTFIX_NATIVE"
# Flags of /proc/cpuinfo that each module needs, the newest instruction set first.
NEEDED_FLAGS = {
    "avx512": {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl", "avx512_vpopcntdq", "bmi2", "fma"},
    "avx2": {"avx2", "bmi1", "bmi2", "f16c", "fma", "movbe"},
    "baseline": set[str](),
}


def load_kernels() -> ModuleType:
    """Returns the compiled module.

    Raises:
        ImportError: it was not built, or ``FIRSTFIX_NATIVE`` is ``off`` or names no module of this machine.
    """
    wanted = os.environ.get(VARIABLE) or "auto"
    if wanted == "off":
        raise ImportError(f"the compiled core is switched off: {VARIABLE}=off")
    names = runnable() if wanted == "auto" else [wanted]
    for name in names:
        if name in built():
            return import_module(f"._{name}", __package__)
    raise ImportError(f"the compiled core has no module for {', '.join(names)}: build it with `make setup`")


def built() -> list[str]:
    """Names of the modules that were built, the newest instruction set first."""
    here = Path(__file__).parent
    return [name for name in NEEDED_FLAGS if any(here.glob(f"_{name}.*"))]


def runnable() -> list[str]:
    """Names of the modules that this processor can run, the newest instruction set first."""
    flags = _processor_flags()
    return [name for name, needed in NEEDED_FLAGS.items() if needed <= flags]


def _processor_flags() -> set[str]:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:  # not Linux
        return set()
    return next((set(line.partition(":")[2].split()) for line in lines if line.startswith("flags")), set())
