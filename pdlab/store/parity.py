"""What predicted against measured is filtered by and judged beside; the mixtures to choose from."""

from collections.abc import Sequence
from dataclasses import dataclass

import sqlalchemy as sa
from sqlalchemy.orm import Session, aliased

from pdlab.density import WATER_DENSITY
from pdlab.models import Aggregate, Comparison, Mixture, MixtureComponent, PackingTest
from pdlab.store.selects import parts


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
    """What the current density tests of a mixture's aggregates say of each alone.

    ``way``: the one compaction of them all, unstated as loose, as it is simulated; empty where they were tested in
    several, or one was not. ``mean``: Σ y_i PD_i [-], None where there is no such way.
    """

    mean: float | None
    way: str


def each_alone(session: Session, mixture_ids: Sequence[int] | None = None) -> dict[int, Alone]:
    """Return what is known of the aggregates of each of these mixtures, or of all, by the mixture's id."""
    known, part = _alone(), MixtureComponent.__table__.c
    mean = sa.func.sum(part.solid_volume_share * known.c.density) / sa.func.sum(part.solid_volume_share)
    first, last = sa.func.min(known.c.way), sa.func.max(known.c.way)
    alike = (sa.func.count(known.c.density) == sa.func.count()) & (first == last)
    query = (
        sa.select(part.mixture_id, sa.case((alike, mean)), sa.case((alike, first), else_=""))
        .join_from(MixtureComponent, known, known.c.id == part.aggregate_id)
        .group_by(part.mixture_id)
    )
    some = [query] if mixture_ids is None else [query.where(part.mixture_id.in_(few)) for few in parts(mixture_ids)]
    return {key: Alone(mean, way) for one in some for key, mean, way in session.execute(one).all()}


def _alone() -> sa.CTE:
    """Return each aggregate's packing density alone and its test's compaction, missing where it was not tested."""
    one, test, other = Aggregate, PackingTest, aliased(PackingTest)
    newest = sa.select(sa.func.max(other.id)).where(other.aggregate_id == one.id)
    density = sa.func.coalesce(
        test.packing_density, 1.0 - test.voids_percent / 100.0, test.bulk_density_kg_m3 / _oven_dry()
    )
    way = sa.case((test.compaction == "unstated", "loose"), else_=test.compaction)
    found = (
        sa.select(one.id, density.label("density"), way.label("way"))
        .select_from(one)
        .outerjoin(test, test.id == newest.correlate(one).scalar_subquery())
    )
    return found.cte("alone").prefix_with("MATERIALIZED")  # once for each aggregate, not for each part of a mixture


def _oven_dry() -> sa.ColumnElement[float]:
    """Return an aggregate's oven-dry particle density [kg/m³], as ``density.oven_dry_density`` has it."""
    given, absorbed = Aggregate.particle_density_kg_m3, Aggregate.water_absorption_percent / 100.0
    dry = {
        "oven_dry": given,
        "ssd": given / (1.0 + absorbed),
        "apparent": 1.0 / (1.0 / given + absorbed / WATER_DENSITY),
    }
    return sa.case(dry, value=Aggregate.density_basis)


def newest_mixtures(session: Session, most: int) -> dict[int, str]:
    """Return the names of so many of the newest mixtures by their ids, the newest first."""
    query = sa.select(Mixture.id, Mixture.name).order_by(Mixture.id.desc()).limit(most)
    return {row.id: row.name for row in session.execute(query)}
