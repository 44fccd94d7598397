"""Plans: work that says which beds it wants next and is handed what they gave, until it has its result.

A plan runs nothing itself, so that whoever runs beds may carry on many at once, stop between two beds, or only
count what a plan would cost.
"""

from collections.abc import Callable, Generator, Sequence
from typing import Any, TypeVar
from typing import Protocol as Interface

from pdlab.errors import EngineError
from pdlab.specimen import Packing, Specimen

T = TypeVar("T")
Outcome = Packing | EngineError
"""What a specimen gave: its packing, or why there is none."""
Plan = Generator[Sequence[Specimen], Sequence[Outcome], T]
"""Yields specimens, is sent their outcomes in the same order, and returns its result."""


class RunAll(Interface):
    """Runs specimens by its engine, or reads those already run; returns in the same order what each gave."""

    @property
    def engine_version(self) -> int:
        """The version of the engine whose runs it gives."""

    def __call__(self, specimens: Sequence[Specimen], /) -> Sequence[Outcome]:
        """Return what the specimens gave."""


def finish(plan: Plan[T], run_all: Callable[[Sequence[Specimen]], Sequence[Outcome]]) -> T:
    """Carry a plan on to its result."""
    outcomes: Sequence[Outcome] | None = None
    while True:
        try:
            wanted = next(plan) if outcomes is None else plan.send(outcomes)
        except StopIteration as end:
            result: T = end.value
            return result
        outcomes = run_all(wanted)


def at_once(plan: Plan[T]) -> T | None:
    """Return the result of a plan that needs no bed; None of one that does, which is given up."""
    try:
        next(plan)
    except StopIteration as end:
        result: T = end.value
        return result
    plan.close()
    return None


def together(plans: Sequence[Plan[T]]) -> Plan[list[T]]:
    """Return one plan that carries several on side by side, with their results in order."""
    results, sending = dict[int, T](), dict[int, Any](dict.fromkeys(range(len(plans))))
    while sending:
        wanted = dict[int, Sequence[Specimen]]()
        for k, outcomes in sending.items():
            try:
                wanted[k] = plans[k].send(outcomes)
            except StopIteration as end:
                results[k] = end.value
        found = (yield [bed for beds in wanted.values() for bed in beds]) if wanted else ()
        at = 0
        sending = {}
        for k, beds in wanted.items():
            sending[k] = found[at : at + len(beds)]
            at += len(beds)
    return [results[k] for k in range(len(plans))]
