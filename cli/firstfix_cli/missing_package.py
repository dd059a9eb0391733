"""Words for a package that is not installed."""

from __future__ import annotations

import sys

from firstfix.errors import pip_install


def missing_package(error: ModuleNotFoundError) -> str:
    """The error's own words, or which extras have the package where it has only Python's."""
    if str(error) != f"No module named {error.name!r}":
        return str(error)
    too_old = "" if sys.version_info >= (3, 11) else "; both need Python 3.11 or newer"
    return (
        f"the package {error.name} is not installed: {pip_install('.[service]')}, "
        f"or '.[builder]', which builds maps too{too_old}"
    )
