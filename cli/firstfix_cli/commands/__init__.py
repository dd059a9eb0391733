"""One file for each command or group. Imports are inside the functions, so that ``--help`` is quick."""
