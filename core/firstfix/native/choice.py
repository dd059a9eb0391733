"""Choice of the compiled module: the newest instruction set that the processor has."""

from __future__ import annotations

import os
from importlib import import_module
from importlib.machinery import EXTENSION_SUFFIXES
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
    """The compiled module.

    Raises:
        ModuleNotFoundError: it was not built, or ``FIRSTFIX_NATIVE`` is ``off``.
        ImportError: ``FIRSTFIX_NATIVE`` names a module that this processor cannot run.
    """
    wanted = os.environ.get(VARIABLE) or "auto"
    if wanted == "off":
        raise ModuleNotFoundError(
            f"the compiled core is switched off ({VARIABLE}=off): the service and the builder need it"
        )
    names = runnable()
    if wanted != "auto":
        if wanted not in names:
            raise ImportError(
                f"{VARIABLE} is {wanted!r}: on this processor it can be auto, {', '.join(names)} or off"
            )
        names = [wanted]
    name = next((name for name in names if _is_built(name)), None)
    if name is None:
        raise ModuleNotFoundError(
            f"the compiled core is not built for this Python and processor ({' or '.join(names)}): "
            "run `make setup` in the repository, or install a wheel of firstfix"
        )
    return import_module(f"._{name}", __package__)


def runnable() -> list[str]:
    """Names of the modules that this processor can run, the newest instruction set first."""
    flags = _processor_flags()
    return [name for name, needed in NEEDED_FLAGS.items() if needed <= flags]


def _is_built(name: str) -> bool:
    return any((Path(__file__).parent / f"_{name}{suffix}").is_file() for suffix in EXTENSION_SUFFIXES)


def _processor_flags() -> set[str]:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:  # not Linux
        return set()
    return next((set(line.partition(":")[2].split()) for line in lines if line.startswith("flags")), set())
