"""``python -m firstfix_lab``: the program ``firstfix-lab``."""

from .entrance import run

run()
