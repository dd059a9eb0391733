"""The online side: HTTP and zenoh over one use case."""

import sys

# structlog loads rich for tracebacks that this service does not draw, and rich takes a tenth of its start.
if "rich" not in sys.modules:
    sys.modules["rich"] = None  # type: ignore[assignment]  # as if it were not installed
    try:
        import structlog as _structlog  # noqa: F401
    finally:
        del sys.modules["rich"]
