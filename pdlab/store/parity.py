"""What predicted against measured is filtered by and judged beside; the mixtures to choose from."""

from collections.abc import Sequence
from dataclasses import dataclass

import sqlalchemy as sa
from sqlalchemy.orm import Session, aliased

from pdlab.models import Aggregate, Calibration, Comparison, Mixture, MixtureComponent, PackingTest
from pdlab.store.selects import parts

ENDS = (sa.func.min, sa.func.max)


def names_in_mixtures(session: Session, most: int) -> list[str]:
    """Return the names of aggregates that mixtures hold, without regard to case in their order, so many at most."""
    held = sa.exists().where(MixtureComponent.aggregate_id == Aggregate.id)
    rank = sa.func.lower(Aggregate.name)
    named = sa.select(Aggregate.name).where(held).group_by(Aggregate.name).order_by(rank, Aggregate.name)
    return list(session.scalars(named.limit(most)))


def methods(session: Session) -> list[str]:
    """Return the methods that mixtures were predicted by."""
    found = sa.select(Comparison.method).where(Comparison.method != "").distinct().order_by(Comparison.method)
    return list(session.scalars(found))


@dataclass(frozen=True)
class Alone:
    """What is known of a mixture's aggregates, each alone.

    ``mean``: Σ y_i PD_i [-] of their last calibrations, None where one has none to a density test; where one was
    tested anew since, the mixture's predictions are outdated. ``ways``: the compactions of their current density
    tests, the first and the last by name, unstated as loose, as it is simulated; both empty where one was not tested.
    """

    mean: float | None
    ways: tuple[str, str]


def each_alone(session: Session, mixture_ids: Sequence[int] | None = None) -> dict[int, Alone]:
    """Return what is known of the aggregates of each of these mixtures, or of all, by the mixture's id."""
    known, part = _alone(), MixtureComponent.__table__.c
    every, weight = sa.func.count(), sa.func.sum(part.solid_volume_share)
    mean = sa.func.sum(part.solid_volume_share * known.c.density) / weight
    query = (
        sa.select(
            part.mixture_id,
            sa.case((sa.func.count(known.c.density) == every, mean)),
            *(sa.case((sa.func.count(known.c.way) == every, end(known.c.way)), else_="") for end in ENDS),
        )
        .join_from(MixtureComponent, known, known.c.id == part.aggregate_id)
        .group_by(part.mixture_id)
    )
    some = [query] if mixture_ids is None else [query.where(part.mixture_id.in_(few)) for few in parts(mixture_ids)]
    found = (row for one in some for row in session.execute(one).all())
    return {key: Alone(mean, (first, last)) for key, mean, first, last in found}


def _alone() -> sa.CTE:
    """Return each aggregate's packing density alone and the compaction of its test, missing where there is none."""
    one, known, other = Aggregate, aliased(Calibration), aliased(PackingTest)
    last = sa.select(sa.func.max(known.id)).where(
        known.aggregate_id == one.id, known.measured_packing_density.is_not(None)
    )
    newest = sa.select(sa.func.max(other.id)).where(other.aggregate_id == one.id)
    way = sa.case((PackingTest.compaction == "unstated", "loose"), else_=PackingTest.compaction)
    found = (
        sa.select(one.id, Calibration.measured_packing_density.label("density"), way.label("way"))
        .select_from(one)
        .outerjoin(Calibration, Calibration.id == last.correlate(one).scalar_subquery())
        .outerjoin(PackingTest, PackingTest.id == newest.correlate(one).scalar_subquery())
    )
    return found.cte("alone").prefix_with("MATERIALIZED")  # once for each aggregate, not for each part of a mixture


def newest_mixtures(session: Session, most: int) -> dict[int, str]:
    """Return the names of so many of the newest mixtures by their ids, the newest first."""
    query = sa.select(Mixture.id, Mixture.name).order_by(Mixture.id.desc()).limit(most)
    return {row.id: row.name for row in session.execute(query)}
