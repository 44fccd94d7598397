"""The curves of packing density, or angle, over friction that the store holds, and how calibrations grow them."""

from collections.abc import Iterable, Mapping, Sequence

from pdlab import calibration, store
from pdlab.calibration import NODES, Curve, Ladder
from pdlab.errors import EngineError
from pdlab.experiments.readings import packing_of
from pdlab.plan import Plan
from pdlab.specimen import Packing
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
        """Read what the store holds of ladders, all in one query."""
        new = [ladder for ladder in dict.fromkeys(ladders) if ladder not in self._nodes]
        beds = [(ladder, node, bed) for ladder in new for node in NODES for bed in ladder.beds(node, MOST_SEEDS)]
        digests = [bed.digest(self.engine_version) for _, _, bed in beds]
        with self._target.read() as session:
            done = {digest: packing_of(run) for digest, run in store.done_runs(session, digests).items()}
        self._nodes |= {ladder: {} for ladder in new}
        for (ladder, node, _), digest in zip(beds, digests, strict=True):
            if digest in done:
                self._nodes[ladder].setdefault(node, []).append(done[digest])

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
        """Ask for so many beds at nodes; what fails stands in ``errors``."""
        beds = {(ladder, node): ladder.beds(node, seeds) for (ladder, node), seeds in wanted.items()}
        outcomes = iter((yield [bed for several in beds.values() for bed in several]))
        for (ladder, node), several in beds.items():
            found = [next(outcomes) for _ in several]
            known = {packing.digest: packing for packing in self._nodes[ladder].get(node, [])}
            known |= {outcome.digest: outcome for outcome in found if isinstance(outcome, Packing)}
            self._nodes[ladder][node] = list(known.values())
            failed = next((outcome for outcome in found if isinstance(outcome, EngineError)), None)
            if failed is not None:
                self.errors[ladder, node] = failed
