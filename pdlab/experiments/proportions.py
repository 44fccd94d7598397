"""What sweeps found, as it is drawn: PD over the proportions, what was measured, what is outdated; a wish for one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from sqlalchemy.orm import Session

from pdlab import density, store
from pdlab.errors import InputError, UnknownName
from pdlab.experiments.mixing import aggregates_of, full_name
from pdlab.experiments.readings import is_stale, measured_aggregate, particle_density, protocol_kept
from pdlab.experiments.sweeps import MeasuredMix, measured_mixes, rests_on_measured, result_of
from pdlab.experiments.theories import over_shares
from pdlab.experiments.waiting import Waiting, waiting_of
from pdlab.experiments.ways import Way, way_kept
from pdlab.experiments.wishes import ask_sweep
from pdlab.models import Aggregate, Calibration, Sweep
from pdlab.store import Store
from pdlab.surface import Floats
from pdlab.sweep import WISHED_ERROR, Swept

THEORIES = ("toufar", "cpm")
"""Drawn beside the sweep of two aggregates."""


@dataclass(frozen=True)
class ListedSweep:
    """A sweep in a list: the names of its aggregates with deliveries, by which method, and what became of it."""

    sweep_id: int
    aggregates: tuple[str, ...]
    method: str
    state: str


@dataclass(frozen=True)
class Proportions:
    """A sweep with what stands beside it; ``names`` with deliveries; ``message``: why there is no ``result``.

    ``alone``: the density tests of the aggregates, and ``measured`` of mixtures of them alone, in the compaction of
    their calibrations. ``theories``: PD [-] over the result's shares, shape (M,), of two aggregates, ``without``: why
    one is absent. ``mass_shares``: of the densest mix and the one to test next [-], None without particle densities.
    ``outdated``: why it is not what the store would give now.
    """

    sweep_id: int
    ids: tuple[int, ...]
    names: tuple[str, ...]
    method: str
    state: str
    result: Swept | None = None
    message: str = ""
    alone: tuple[MeasuredMix, ...] = ()
    measured: tuple[MeasuredMix, ...] = ()
    theories: Mapping[str, Floats] = field(default_factory=dict)
    without: Mapping[str, str] = field(default_factory=dict)
    mass_shares: tuple[tuple[float, ...] | None, tuple[float, ...] | None] = (None, None)
    outdated: tuple[str, ...] = ()


def newest_sweeps(target: Store, most: int) -> list[ListedSweep]:
    """Return so many of the sweeps asked for last, the newest first."""
    with target.read() as session:
        rows = store.newest_sweeps(session, most)
    return [
        ListedSweep(row.id, tuple(full_name(part.aggregate) for part in row.components), row.method, row.state)
        for row in rows
    ]


def ask_proportions(target: Store, ids: Sequence[int], method: str) -> int:
    """Wish for a sweep of aggregates unless it is there; return the id of what is there, or of the wish.

    What is there is of the newest engine that the store knows: a runner works with its own. Raises UnknownName,
    InputError for too few or too many.
    """
    with target.read() as session:
        rows, newest = aggregates_of(session, list(dict.fromkeys(ids))), store.newest_engine(session) or 0
    found = ask_sweep(target, rows, Way(method), WISHED_ERROR, None, newest)
    key = found[1] if isinstance(found, tuple) else found.sweep_id
    if key is None:
        raise InputError("the sweep was deleted while it was read; ask again")
    return key


def waiting_sweep(target: Store, sweep_id: int) -> Waiting | None:
    """Return how far a sweep is that has not ended; None where it has, or is none."""
    with target.read() as session:
        row = store.find_row(session, Sweep, sweep_id)
        return None if row is None or row.state not in store.WAITING else waiting_of(session, ("sweep", row.id), row)


def proportions(target: Store, sweep_id: int) -> Proportions:
    """Return a sweep with what stands beside it. Raises UnknownName."""
    with target.read() as session:
        row = next(iter(store.sweeps_by_id(session, [sweep_id])), None)
        if row is None:
            raise UnknownName(f"the store holds no sweep {sweep_id}; choose another")
        aggregates = aggregates_of(session, store.swept(row))
        fits = store.calibrations_by_id(session, [link.calibration_id for link in row.calibrations])
        measured = _measured(session, aggregates, fits)
        newest = store.newest_engine(session)
    if row.state != "done":
        return Proportions(
            row.id, tuple(one.id for one in aggregates), tuple(map(full_name, aggregates)), row.method, row.state,
            message=row.message or "",
        )  # fmt: skip
    result = result_of(row)
    test = result.next_test
    theories, without = _theories(row, aggregates, result)
    return Proportions(
        row.id, tuple(one.id for one in aggregates), tuple(map(full_name, aggregates)), row.method, row.state, result,
        alone=_alone(aggregates), measured=tuple(measured), theories=theories, without=without,
        mass_shares=(_by_mass(aggregates, result.densest.shares), _by_mass(aggregates, test.shares if test else None)),
        outdated=tuple(_outdated(row, fits, measured, newest)),
    )  # fmt: skip


def _measured(session: Session, aggregates: Sequence[Aggregate], fits: Sequence[Calibration]) -> list[MeasuredMix]:
    """Return the tested mixtures of aggregates, none of a sweep that rests on no calibration."""
    if not fits:
        return []
    return measured_mixes(session, [row.id for row in aggregates], protocol_kept(fits[0]).compaction)


def _alone(aggregates: Sequence[Aggregate]) -> tuple[MeasuredMix, ...]:
    """Return the current density tests of aggregates, each as a mixture of itself alone."""
    out = list[MeasuredMix]()
    for k, row in enumerate(aggregates):
        shares = tuple(float(k == other) for other in range(len(aggregates)))
        if (measured := measured_aggregate(row)) is not None:
            out.append(MeasuredMix(full_name(row), shares, measured.packing_density, measured.standard_error))
    return tuple(out)


def _theories(row: Sweep, aggregates: Sequence[Aggregate], result: Swept) -> tuple[dict[str, Floats], dict[str, str]]:
    """Return what theory makes of the proportions of two aggregates, and why one makes nothing of them."""
    if len(aggregates) != 2:
        return {}, {}
    rule = way_kept(row).rule
    values, errors = over_shares(aggregates, np.asarray(result.shares), rule, THEORIES)
    return values, {name: str(error) for name, error in errors.items()}


def _by_mass(aggregates: Sequence[Aggregate], shares: Sequence[float] | None) -> tuple[float, ...] | None:
    """Return the mass shares of a mix [-], None without one and where a particle density is unknown."""
    known = [value for row in aggregates if (value := particle_density(row)) is not None]
    if shares is None or len(known) < len(aggregates):
        return None
    return tuple(density.mass_shares(shares, known))


def _outdated(
    row: Sweep, fits: Sequence[Calibration], measured: Sequence[MeasuredMix], newest: int | None
) -> list[str]:
    """Return why a sweep is not what the store would give now; empty where it is."""
    out = list[str]()
    if stale := [fit.aggregate.name for fit in fits if is_stale(fit)]:
        out.append(f"{', '.join(sorted(stale))}: tested or sieved anew since, or corrected; sweep again")
    if row.engine_version is not None and newest is not None and row.engine_version < newest:
        out.append(f"by an older engine (version {row.engine_version}), now it is {newest}; sweep again")
    if not rests_on_measured(row, measured):
        out.append("mixtures of these aggregates were measured since: another may be the one to test next; sweep again")
    return out
