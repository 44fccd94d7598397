"""The runs of equal spheres that are shipped with pdlab: both edges of friction and rolling friction, and inside.

``python tests/validation/equal_spheres.py STORE`` runs in the store what it does not hold yet, so that a run broken off
carries on where it was, and writes the table ``pdlab/data/equal_spheres/runs.csv``. Some two hours on one core.
"""

import sys
from typing import Annotated

import typer

from pdlab.batch.progress import Progress
from pdlab.batch.runner import Runner
from pdlab.calibration import MONOSIZED, NODES, ROLLING, ROUGHEST, Ladder
from pdlab.experiments import shipped
from pdlab.packing import VERSION
from pdlab.specimen import Specimen, equal_spheres, protocol_of, with_seeds
from pdlab.store import done_runs, open_store

ONE = ((1.0, 1.0),)
EDGE_SEEDS = {"loose": 8, "rodded": 4, "vibrated": 4}
COARSE = (0.05, 0.2, 0.5)
INSIDE = {"loose": (NODES[:-1], NODES[1:]), "rodded": (COARSE, COARSE), "vibrated": (COARSE, COARSE)}
"""Frictions below 1 and rolling frictions above 0 of the beds off the edges."""
INSIDE_SEEDS = 2


def edges(compaction: str) -> list[Specimen]:
    """Return the beds of the two curves of a calibration: no rolling friction, and a friction of 1."""
    ladders = [Ladder(method, ONE, protocol_of(compaction)) for method in (MONOSIZED, ROLLING)]
    beds = [bed for ladder in ladders for node in NODES for bed in ladder.beds(node, EDGE_SEEDS[compaction])]
    return list(dict.fromkeys(beds))


def inside(compaction: str) -> list[Specimen]:
    """Return the beds between the edges."""
    frictions, rollings = INSIDE[compaction]
    assert ROUGHEST not in frictions
    assert 0.0 not in rollings
    seeds = range(1, INSIDE_SEEDS + 1)
    firsts = [equal_spheres(mu, 1, protocol_of(compaction), mu_r) for mu in frictions for mu_r in rollings]
    return [bed for first in firsts for bed in with_seeds(first, seeds)]


def all_beds() -> list[Specimen]:
    """Return all beds that are shipped."""
    return [bed for compaction in EDGE_SEEDS for bed in (*edges(compaction), *inside(compaction))]


def main(address: Annotated[str, typer.Argument(metavar="STORE")] = "equal_spheres.db") -> None:
    """Run what is missing and write the table."""
    target = open_store(address)
    runner = Runner(target, on_progress=_tell)
    outcomes = runner(beds := all_beds())
    runner.close()
    failed = [outcome for outcome in outcomes if isinstance(outcome, Exception)]
    if failed:
        raise failed[0]
    with target.read() as session:
        runs = done_runs(session, [bed.digest(VERSION) for bed in beds])
    shipped.write_table(shipped.TABLE, [(bed, runs[bed.digest(VERSION)]) for bed in beds])
    print(f"{len(beds)} runs of engine version {VERSION} written to {shipped.TABLE}")


def _tell(progress: Progress) -> None:
    done, wanted = progress.simulated, progress.wanted - progress.read
    print(f"\r{done} of {wanted} beds", end="", file=sys.stderr, flush=True)


if __name__ == "__main__":
    typer.run(main)
