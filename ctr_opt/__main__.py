"""``python -m ctr_opt``."""

from .cli import main

main()
