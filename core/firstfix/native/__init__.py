"""Compiled core: the kernels of ``native/``, from the module that fits this machine's processor.

The environment variable ``FIRSTFIX_NATIVE`` names another module (``baseline``, ``avx2``, ``avx512``), or
``off``. All of them give the same results to the last bit.
"""

from .choice import load_kernels

_kernels = load_kernels()
globals().update({name: value for name, value in vars(_kernels).items() if not name.startswith("_")})
