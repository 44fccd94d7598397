"""The curves of packing density, or angle, over friction that the store holds, and how calibrations grow them."""

from collections.abc import Iterable, Mapping, Sequence

from pdlab import calibration, store
from pdlab.calibration import NODES, Curve, Ladder
from pdlab.errors import EngineError
from pdlab.experiments import shipped
from pdlab.experiments.readings import packing_of
from pdlab.plan import Plan
from pdlab.specimen import Packing, Specimen
from pdlab.store import Store

MOST_SEEDS = 16
"""Beds at a node that are looked for in the store."""


class Curves:
    """Curves by ladder: what the store holds of them, and what is run since; ``errors``: of nodes that failed.

    ``engine_version``: of the engine whose runs they hold.
    """

    def __init__(self, target: Store, engine_version: int) -> None:
        self._target, self.engine_version = target, engine_version
        self._nodes = dict[Ladder, dict[float, list[Packing]]]()
        self.errors = dict[tuple[Ladder, float], EngineError]()

    def load(self, ladders: Iterable[Ladder]) -> None:
        """Read what the store holds of ladders, all in one query, once what is shipped of them stands there too.

        Raises TableError when the table of shipped runs is damaged.
        """
        new = [ladder for ladder in dict.fromkeys(ladders) if ladder not in self._nodes]
        beds = [(ladder, node, bed) for ladder in new for node in NODES for bed in ladder.beds(node, MOST_SEEDS)]
        digests = [bed.digest(self.engine_version) for _, _, bed in beds]
        done = self._done({digest: bed for (_, _, bed), digest in zip(beds, digests, strict=True)})
        self._nodes |= {ladder: {} for ladder in new}
        for (ladder, node, _), digest in zip(beds, digests, strict=True):
            if digest in done:
                self._nodes[ladder].setdefault(node, []).append(done[digest])

    def _done(self, beds: dict[str, Specimen]) -> dict[str, Packing]:
        """Return what beds, given by their digests, have given; shipped runs that the store lacks are written to it."""
        with self._target.read() as session:
            found = store.done_runs(session, list(beds))
        lacking = shipped.runs({digest: bed for digest, bed in beds.items() if digest not in found})
        if lacking:
            with self._target.write() as session:
                store.add_runs(session, lacking)
                found |= store.done_runs(session, [run.specimen_hash for run in lacking])
        return {digest: packing_of(run) for digest, run in found.items()}

    def known(self, ladder: Ladder) -> Curve | None:
        """Return a ladder's curve as far as it is known, None where no bed is."""
        return calibration.curve(self._nodes.get(ladder, {}), ladder.sought)

    def reach(self, ladder: Ladder) -> tuple[float | None, float | None]:
        """Return the least and the largest value of a ladder, at its ends, None where that end is not simulated."""
        return calibration.reach(self._nodes[ladder], ladder.sought)

    def runs(self, ladder: Ladder) -> Mapping[float, Sequence[Packing]]:
        """Return a ladder's runs by node."""
        return self._nodes[ladder]

    def evidence(self, ladder: Ladder) -> list[Packing]:
        """Return the runs that a ladder's curve rests on."""
        known = self.known(ladder)
        nodes = [] if known is None else [point.value for point in known.points]
        return [packing for node in nodes for packing in self._nodes[ladder][node]]

    def extend(self, wanted: Mapping[tuple[Ladder, float], int]) -> Plan[None]:
        """Ask for so many beds at nodes, as far as they are not known; what fails stands in ``errors``."""
        beds = [
            (ladder, node, bed)
            for (ladder, node), seeds in wanted.items()
            for bed in ladder.beds(node, seeds)
            if bed.digest(self.engine_version) not in self._digests(ladder, node)
        ]
        outcomes = (yield [bed for _, _, bed in beds]) if beds else ()
        for (ladder, node, _), outcome in zip(beds, outcomes, strict=True):
            if isinstance(outcome, Packing):
                self._nodes[ladder].setdefault(node, []).append(outcome)
            else:
                self.errors.setdefault((ladder, node), outcome)

    def _digests(self, ladder: Ladder, node: float) -> set[str]:
        return {packing.digest for packing in self._nodes[ladder].get(node, [])}
