"""``python -m pdlab.cli``."""

from pdlab.cli import main

main()
