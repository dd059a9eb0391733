"""The command line of firstfix."""

import os

# Each query runs in its own thread. With several BLAS threads for each, they would wait for one another:
# 120 ms over HTTP instead of 85. NumPy reads the variable when it is first imported, so it is set here.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
