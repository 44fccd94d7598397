"""A mixture put together: shares of which the last is the rest, its grading and density; a wish for its prediction."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import pandas as pd
from sqlalchemy.orm import Session

from pdlab import density, grading, store, tables
from pdlab.errors import InputError, PdlabError, UnknownName
from pdlab.experiments.evidence import DensityTest, density_tests
from pdlab.experiments.readings import current_grading, mean_density, particle_density
from pdlab.experiments.registration import register
from pdlab.experiments.waiting import Waiting, waiting_of
from pdlab.experiments.ways import Way
from pdlab.experiments.wishes import ask_predictions
from pdlab.grading import Grading
from pdlab.models import Aggregate, Mixture
from pdlab.store import Store


@dataclass(frozen=True)
class SharesRead:
    """Typed shares: ``shares`` [-], None where they are not sound; the ``rest`` [%]; what is ``wrong`` with each.

    ``rest``: what is left for the last aggregate, None where another's share cannot be read. ``wrong``: a sentence
    for each aggregate, empty where nothing is.
    """

    shares: tuple[float, ...] | None
    rest: float | None
    wrong: tuple[str, ...]


@dataclass(frozen=True)
class Composed:
    """What a mixture is made of, in the order of its aggregates.

    ``names`` with deliveries; ``shares`` of the solid volume and, where all particle densities are known,
    ``mass_shares`` [-]; ``gradings`` by name, and the mixture's, None where an aggregate is not sieved;
    ``particle_density`` [kg/m³], oven-dry, None where one of ``undense`` is unknown.
    """

    name: str
    names: tuple[str, ...]
    shares: tuple[float, ...]
    mass_shares: tuple[float, ...] | None
    gradings: Mapping[str, Grading]
    combined: Grading | None
    particle_density: float | None
    undense: tuple[str, ...] = ()
    unsieved: tuple[str, ...] = ()


def read_shares(texts: Sequence[str]) -> SharesRead:
    """Return the shares that texts in percent give: of all aggregates but the last, which has the rest."""
    values, wrong = list[float](), list[str]()
    for text in texts:
        try:
            values.append(tables.above_zero("%")(text))
            wrong.append("")
        except InputError as error:
            wrong.append(str(error))
    if any(wrong):
        return SharesRead(None, None, (*wrong, ""))
    total = math.fsum(values)
    rest = 100.0 - total
    if not rest > 0.0:
        message = f"the others sum to {total:g} %, which leaves {rest:g} %, not above 0; lower one of them"
        return SharesRead(None, rest, (*wrong, message))
    return SharesRead((*(value / 100.0 for value in values), rest / 100.0), rest, (*wrong, ""))


def compose(target: Store, ids: Sequence[int], shares: Sequence[float], by_mass: bool) -> Composed:
    """Return what a mixture of aggregates with these shares [-] would be. Raises UnknownName, InputError."""
    with target.read() as session:
        rows = aggregates_of(session, ids)
    densities = [particle_density(row) for row in rows]
    if not by_mass:
        return _composed("", rows, tuple(shares))
    missing = [full_name(row) for row, known in zip(rows, densities, strict=True) if known is None]
    if missing:
        raise InputError(
            f"shares by mass need a particle density of {', '.join(missing)}; enter it, or give shares by solid volume"
        )
    solid = density.solid_volume_shares(list(shares), [float(known or 0.0) for known in densities])
    return _composed("", rows, tuple(solid))


def composition(target: Store, mixture_id: int) -> Composed:
    """Return what a stored mixture is made of. Raises UnknownName."""
    with target.read() as session:
        blend = stored_mixture(session, mixture_id)
        rows = aggregates_of(session, [part.aggregate_id for part in blend.components])
    shares = [part.solid_volume_share for part in blend.components]
    whole = math.fsum(shares)  # 1 but for rounding
    return _composed(blend.name, rows, tuple(share / whole for share in shares))


def register_mixture(target: Store, name: str, ids: Sequence[int], shares: Sequence[float], by_mass: bool) -> int:
    """Write a mixture as mixtures.csv would; return its id, that of an equal one where it is there.

    Raises TableError with every problem, UnknownName.
    """
    with target.read() as session:
        rows = aggregates_of(session, ids)
    kind = "mass_share" if by_mass else "solid_volume_share"
    lines = [
        {"mixture": name, "aggregate": row.name, "delivery": row.delivery, kind: share}
        for row, share in zip(rows, shares, strict=True)
    ]
    register(target, tables.read_frames({"mixtures": pd.DataFrame(lines)}))
    with target.read() as session:
        made = store.find_mixture(session, name.strip())
    if made is None:  # deleted by another in between
        raise UnknownName(f"mixture '{name.strip()}' is gone again; save it anew")
    return made.id


def mixture_names(target: Store, most: int) -> dict[int, str]:
    """Return the names of so many of the newest mixtures by their ids, the newest first."""
    with target.read() as session:
        return store.newest_mixtures(session, most)


def mixture_tests(target: Store, mixture_id: int) -> tuple[DensityTest, ...]:
    """Return a mixture's density tests as they were entered, the newest last. Raises UnknownName."""
    with target.read() as session:
        row = stored_mixture(session, mixture_id)
    return density_tests(row.packing_tests, mean_density(row))


def ask_prediction(target: Store, mixture_id: int, method: str) -> str:
    """Wish for a prediction unless it is there; return why there can be none, empty where nothing stands against it.

    What is there is of the newest engine that the store knows: a runner works with its own. Raises UnknownName.
    """
    with target.read() as session:
        row = stored_mixture(session, mixture_id)
        newest = store.newest_engine(session) or 0
    try:
        asked = ask_predictions(target, [row], Way(method), newest)
    except PdlabError as error:
        return str(error)
    report = asked.reports.get(row.id)
    return str(report.error) if report is not None and report.error is not None else ""


def waiting_prediction(target: Store, mixture_id: int) -> Waiting | None:
    """Return the prediction that a mixture waits for, the last asked for; None where it waits for none."""
    with target.read() as session:
        row = store.waiting_prediction(session, mixture_id)
        return None if row is None else waiting_of(session, ("prediction", row.id), row)


def full_name(row: Aggregate) -> str:
    """Return an aggregate's name with its delivery."""
    return f"{row.name} {row.delivery}".strip()


def stored_mixture(session: Session, mixture_id: int) -> Mixture:
    """Return the mixture with this id, with its components and density tests. Raises UnknownName."""
    row = next(iter(store.mixtures_by_id(session, [mixture_id])), None)
    if row is None:
        raise UnknownName(f"the store holds no mixture {mixture_id}; choose another")
    return row


def aggregates_of(session: Session, ids: Sequence[int]) -> list[Aggregate]:
    """Return the aggregates with these ids, in their order, with their tests. Raises UnknownName."""
    known = {row.id: row for row in store.aggregates_by_id(session, ids)}
    for key in ids:
        if key not in known:
            raise UnknownName(f"the store holds no aggregate {key}; choose another")
    return [known[key] for key in ids]


def _composed(name: str, rows: Sequence[Aggregate], shares: tuple[float, ...]) -> Composed:
    names = tuple(map(full_name, rows))
    sieved = {full_name(row): current_grading(row) for row in rows}
    gradings = {one: found for one, found in sieved.items() if found is not None}
    dense = {full_name(row): particle_density(row) for row in rows}
    known = [value for value in dense.values() if value is not None]
    whole = len(known) == len(rows)
    return Composed(
        name, names, shares,
        tuple(density.mass_shares(shares, known)) if whole else None,
        gradings,
        grading.combined(list(gradings.values()), shares) if len(gradings) == len(rows) else None,
        math.fsum(share * value for share, value in zip(shares, known, strict=True)) if whole else None,
        tuple(one for one, value in dense.items() if value is None),
        tuple(one for one, found in sieved.items() if found is None),
    )  # fmt: skip
