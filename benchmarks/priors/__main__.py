"""``python -m benchmarks.priors``: see ``suite``."""

from .suite import main

main()
