"""One file a command or group. They import what they need when they run, so that ``--help`` is quick."""
