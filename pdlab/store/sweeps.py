"""SELECTs of sweeps."""

from collections.abc import Sequence

import sqlalchemy as sa
from sqlalchemy.orm import Session, selectinload

from pdlab.models import Sweep, SweepComponent
from pdlab.store.selects import parts

_SWEEPS = (
    sa.select(Sweep)
    .options(selectinload(Sweep.components).selectinload(SweepComponent.aggregate))
    .options(selectinload(Sweep.runs), selectinload(Sweep.calibrations))
    .order_by(Sweep.requested_at.desc(), Sweep.id.desc())
)


def sweeps_by_id(session: Session, ids: Sequence[int]) -> list[Sweep]:
    """Return sweeps with their aggregates and the links to what they rest on."""
    return [row for part in parts(ids) for row in session.scalars(_SWEEPS.where(Sweep.id.in_(part)))]


def ended_sweeps(session: Session, aggregate_ids: Sequence[int], method: str, variant: str = "") -> list[Sweep]:
    """Return the sweeps of these aggregates, in this order, by a method, done or failed, the last asked for first."""
    of_first = sa.select(SweepComponent.sweep_id).where(
        SweepComponent.aggregate_id == aggregate_ids[0], SweepComponent.position == 0
    )
    query = _SWEEPS.where(Sweep.id.in_(of_first), Sweep.method == method, Sweep.variant == variant)
    rows = session.scalars(query.where(Sweep.state.in_(("done", "failed"))))
    return [row for row in rows if [part.aggregate_id for part in row.components] == list(aggregate_ids)]
