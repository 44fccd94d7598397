"""Everything that docs/validation.md and docs/methods.md show: tables and figures, by one command.

``python tests/validation/make.py`` runs the scripts beside it one after the other, in a folder of its own for
their stores (``--folder``), so that a run broken off carries on where it was. Some three hours on two cores.
"""

import subprocess
import sys
from pathlib import Path
from typing import Annotated

import typer

SCRIPTS = (
    "friction_table.py", "protocols.py", "against_lammps.py", "carried_errors.py", "figures.py", "repose_table.py",
    "methods.py",
)  # fmt: skip


def main(
    folder: Annotated[Path, typer.Option(help="Where the stores of the runs are kept.")] = Path("validation"),
) -> None:
    """Run every script; stop at the first that fails."""
    folder.mkdir(exist_ok=True)
    for script in SCRIPTS:
        print(script, flush=True)
        subprocess.run([sys.executable, Path(__file__).resolve().with_name(script)], cwd=folder, check=True)


if __name__ == "__main__":
    typer.run(main)
