"""SELECTs of sweeps."""

from collections.abc import Mapping, Sequence
from typing import Any

import sqlalchemy as sa
from sqlalchemy.orm import Session, defer, selectinload

from pdlab.models import Mixture, MixtureComponent, PackingTest, Sweep, SweepComponent
from pdlab.store.selects import ENDED, parts
from pdlab.store.wishes import WAITING

_LISTED = (
    sa.select(Sweep)
    .options(selectinload(Sweep.components).selectinload(SweepComponent.aggregate))
    .order_by(Sweep.requested_at.desc(), Sweep.id.desc())
)
_SWEEPS = _LISTED.options(selectinload(Sweep.runs), selectinload(Sweep.calibrations))


def sweeps_by_id(session: Session, ids: Sequence[int]) -> list[Sweep]:
    """Return sweeps with their aggregates and the links to what they rest on."""
    return [row for part in parts(ids) for row in session.scalars(_SWEEPS.where(Sweep.id.in_(part)))]


def newest_sweeps(session: Session, most: int) -> list[Sweep]:
    """Return so many of the sweeps asked for last, the newest first, with their aggregates and without their curves."""
    return list(session.scalars(_LISTED.options(defer(Sweep.curve)).limit(most)))


def measured_blends(session: Session, aggregate_ids: Sequence[int]) -> list[Mixture]:
    """Return the mixtures of these aggregates alone that have a density test, the oldest first."""
    part = MixtureComponent
    inside = sa.select(part.mixture_id).where(part.aggregate_id.in_(aggregate_ids))
    others = sa.select(part.mixture_id).where(part.mixture_id == Mixture.id, part.aggregate_id.not_in(aggregate_ids))
    tested = sa.select(PackingTest.id).where(PackingTest.mixture_id == Mixture.id)
    query = sa.select(Mixture).where(Mixture.id.in_(inside), tested.exists(), ~others.exists()).order_by(Mixture.id)
    load = selectinload(Mixture.components).selectinload(part.aggregate)
    return list(session.scalars(query.options(load, selectinload(Mixture.packing_tests))))


def swept(row: Sweep) -> list[int]:
    """Return the ids of the aggregates of a sweep, in its order."""
    return [part.aggregate_id for part in row.components]


def ended_sweeps(session: Session, aggregate_ids: Sequence[int], method: str, variant: str = "") -> list[Sweep]:
    """Return the sweeps of these aggregates, in this order, by a method, done or failed, the last asked for first."""
    return _of(session, aggregate_ids, ENDED, {"method": method, "variant": variant})


def waiting_sweeps(session: Session, aggregate_ids: Sequence[int], facts: Mapping[str, Any]) -> list[Sweep]:
    """Return the sweeps of these aggregates, in this order and with these facts, that are wished for and not ended."""
    return _of(session, aggregate_ids, WAITING, facts)


def _of(session: Session, ids: Sequence[int], states: Sequence[str], facts: Mapping[str, Any]) -> list[Sweep]:
    of_first = sa.select(SweepComponent.sweep_id).where(
        SweepComponent.aggregate_id == ids[0], SweepComponent.position == 0
    )
    query = _SWEEPS.filter_by(**facts).where(Sweep.id.in_(of_first), Sweep.state.in_(states))
    return [row for row in session.scalars(query) if swept(row) == list(ids)]
