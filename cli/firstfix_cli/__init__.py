"""The one entry point: ``firstfix``."""

import os

# Queries run side by side in threads of their own; a team of BLAS threads for each would only wait for
# one another: 120 ms in place of 85 over HTTP. Read when NumPy is first imported, so it stands here.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
