"""How people name a row of the store: ``KIND:NAME-OR-ID``, or the bare name where it is the only one."""

from collections.abc import Callable, Sequence

from sqlalchemy.orm import Session

from pdlab import store
from pdlab.errors import InputError, UnknownName
from pdlab.models import (
    Aggregate,
    Base,
    Calibration,
    Mixture,
    MixtureComponent,
    PackingTest,
    Prediction,
    SieveAnalysis,
    SieveResult,
    Sweep,
)


def find(session: Session, text: str, kinds: Sequence[str]) -> Base:
    """Return the row that ``text`` names, of one of ``kinds``.

    ``aggregate:NAME`` or ``aggregate:NAME@DELIVERY``, ``mixture:NAME``, ``prediction:ID``, ``sweep:ID``,
    ``calibration:ID`` or the last of an aggregate by its name, ``run:HASH-BEGINNING``, ``sieve_analysis:ID``,
    ``packing_test:ID``, ``sieve_result:ANALYSIS-ID/POSITION``, ``mixture_component:MIXTURE-ID/POSITION``; positions
    count from 0. Raises UnknownName, and InputError where a bare name has several meanings.
    """
    kind, _, name = text.partition(":")
    if kind in FINDERS:
        if kind not in kinds:
            raise InputError(f"a {kind} ('{text}') cannot be named here; name one of {', '.join(kinds)}")
        return FINDERS[kind](session, name.strip())
    found = {}
    for bare in BARE:
        if bare in kinds:
            try:
                found[bare] = FINDERS[bare](session, text)
            except UnknownName:
                continue
    if len(found) > 1:
        raise InputError(f"'{text}' names several things; write one of {', '.join(f'{bare}:{text}' for bare in found)}")
    if not found:
        known = ", ".join(f"{kind}:..." for kind in kinds)
        raise UnknownName(f"the store holds nothing named '{text}'; correct the name, or write {known}")
    return next(iter(found.values()))


def address(row: Base) -> str:
    """Return how a row is named: its kind, and its name or key."""
    if isinstance(row, Aggregate):
        return f"aggregate:{row.name}" + (f"@{row.delivery}" if row.delivery else "")
    if isinstance(row, Mixture):
        return f"mixture:{row.name}"
    return f"{row.__tablename__}:{row_key(row)[:12]}"


def row_key(row: Base) -> str:
    """Return a row's primary key as one text, its parts joined by a slash."""
    return "/".join(str(part) for part in type(row).__mapper__.primary_key_from_instance(row))


def _aggregate(session: Session, text: str) -> Aggregate:
    row = store.find_aggregate(session, text, "")
    if row is None and "@" in text:
        name, delivery = text.rsplit("@", 1)
        row = store.find_aggregate(session, name, delivery, exact=True)
    if row is None:
        others = store.deliveries(session, text)
        if others:
            ways = ", ".join(f"aggregate:{text}@{delivery}" for delivery in others)
            raise InputError(f"aggregate '{text}' came in {len(others)} deliveries; write one of {ways}")
        raise UnknownName(f"the store holds no aggregate '{text}'; see 'pdlab ls aggregates'")
    return row


def _mixture(session: Session, text: str) -> Mixture:
    row = store.find_mixture(session, text)
    if row is None:
        raise UnknownName(f"the store holds no mixture '{text}'; see 'pdlab ls mixtures'")
    return row


def _calibration(session: Session, text: str) -> Calibration:
    row = store.find_row(session, Calibration, int(text)) if text.isdecimal() else None
    if row is None:
        row = store.last_calibration(session, _aggregate(session, text).id)
    if row is None:
        raise UnknownName(f"aggregate '{text}' was not calibrated yet; run 'pdlab calibrate'")
    return row


def _numbered(table: type[Prediction | Sweep | SieveAnalysis | PackingTest]) -> Callable[[Session, str], Base]:
    """Return the finder of a table whose rows are named by their id."""

    def find_one(session: Session, text: str) -> Base:
        row = store.find_row(session, table, int(text)) if text.isdecimal() else None
        if row is None:
            raise UnknownName(
                f"the store holds no {table.__tablename__} '{text}', which takes an id; 'pdlab show' of an aggregate "
                "or a mixture names them"
            )
        return row

    return find_one


def _placed(table: type[SieveResult | MixtureComponent]) -> Callable[[Session, str], Base]:
    """Return the finder of rows that are named by what they are part of and their position there."""

    def find_one(session: Session, text: str) -> Base:
        key = [int(part) for part in text.split("/") if part.isdecimal()]
        row = store.find_row(session, table, (key[0], key[1])) if len(key) == 2 else None
        if row is None:
            raise UnknownName(
                f"the store holds no {table.__tablename__} '{text}', which takes ID/POSITION; 'pdlab show' of the "
                "aggregate or the mixture names them"
            )
        return row

    return find_one


FINDERS: dict[str, Callable[[Session, str], Base]] = {
    "mixture": _mixture,
    "aggregate": _aggregate,
    "prediction": _numbered(Prediction),
    "sweep": _numbered(Sweep),
    "calibration": _calibration,
    "run": store.find_run,
    "sieve_analysis": _numbered(SieveAnalysis),
    "packing_test": _numbered(PackingTest),
    "sieve_result": _placed(SieveResult),
    "mixture_component": _placed(MixtureComponent),
}
BARE = ("mixture", "aggregate", "prediction", "run")
"""Kinds that a name without its kind may be."""
