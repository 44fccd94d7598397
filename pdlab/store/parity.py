"""What predicted against measured is filtered by and judged beside; the mixtures to choose from."""

import itertools
import math
import operator
from dataclasses import dataclass

import sqlalchemy as sa
from sqlalchemy.orm import Session, aliased

from pdlab.models import Aggregate, Calibration, Comparison, Mixture, MixtureComponent, PackingTest


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
    tests, unstated as loose, as it is simulated; none where one was not tested.
    """

    mean: float | None
    ways: frozenset[str]


def each_alone(session: Session) -> dict[int, Alone]:
    """Return what is known of the aggregates of each mixture, by its id."""
    known, part = _alone(session), MixtureComponent
    shares = sa.select(part.mixture_id, part.aggregate_id, part.solid_volume_share).order_by(part.mixture_id)
    out = dict[int, Alone]()
    for key, parts in itertools.groupby(session.execute(shares), key=operator.itemgetter(0)):
        held = [(share, *known[aggregate]) for _, aggregate, share in parts]
        ways = frozenset(way for _, _, way in held if way is not None)
        weighed = [share * density for share, density, _ in held if density is not None]
        mean = math.fsum(weighed) / math.fsum(share for share, _, _ in held) if len(weighed) == len(held) else None
        out[key] = Alone(mean, frozenset() if any(way is None for _, _, way in held) else ways)
    return out


def _alone(session: Session) -> dict[int, tuple[float | None, str | None]]:
    """Return each aggregate's packing density alone and the compaction of its test, None where there is none."""
    one, known, other = Aggregate, aliased(Calibration), aliased(PackingTest)
    last = sa.select(sa.func.max(known.id)).where(
        known.aggregate_id == one.id, known.measured_packing_density.is_not(None)
    )
    newest = sa.select(sa.func.max(other.id)).where(other.aggregate_id == one.id)
    way = sa.case((PackingTest.compaction == "unstated", "loose"), else_=PackingTest.compaction)
    found = (
        sa.select(one.id, Calibration.measured_packing_density, way)
        .select_from(one)
        .outerjoin(Calibration, Calibration.id == last.correlate(one).scalar_subquery())
        .outerjoin(PackingTest, PackingTest.id == newest.correlate(one).scalar_subquery())
    )
    return {key: (density, compaction) for key, density, compaction in session.execute(found)}


def newest_mixtures(session: Session, most: int) -> dict[int, str]:
    """Return the names of so many of the newest mixtures by their ids, the newest first."""
    query = sa.select(Mixture.id, Mixture.name).order_by(Mixture.id.desc()).limit(most)
    return {row.id: row.name for row in session.execute(query)}
