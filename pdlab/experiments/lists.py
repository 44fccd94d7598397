"""Lists of what the store holds, as texts ask for them."""

from collections.abc import Sequence, Set
from dataclasses import replace
from typing import Any

from sqlalchemy.orm import Session

from pdlab import grading, store, tables
from pdlab.errors import ConditionError
from pdlab.experiments.readings import sieve_table
from pdlab.store import Known, Store

SIZES = set(store.SIZES)


def listed(
    target: Store,
    what: str,
    where: Sequence[str] = (),
    columns: Sequence[str] = (),
    sort: str = "",
    limit: int | None = None,
    engine_version: int | None = None,
) -> tuple[list[str], list[tuple[Any, ...]]]:
    """Return the names of a list's columns and its rows.

    ``what``: aggregates, mixtures, runs, predictions or corrections. ``where``: conditions like
    ``packing_density>0.6``, all of them to be met. ``columns``: those usually shown where none is named. ``sort``:
    columns, a comma between them, a minus before one whose values fall. ``limit``: the most rows, None for all.
    Results of an older engine than ``engine_version``, by default the newest there, are outdated. Raises
    ConditionError.
    """
    kinds = store.column_kinds(what)
    conditions = [tables.parse_condition(text, kinds) for text in where]
    order = tables.parse_order(sort, kinds)
    names = list(dict.fromkeys(columns)) or list(store.SHOWN[what])
    tables.check_columns(names, kinds)
    if limit is not None and limit < 1:
        raise ConditionError(f"a list of {limit} rows shows nothing; ask for at least 1")
    search = {*(condition.column for condition in conditions), *(column for column, _ in order)}
    with target.read() as session:
        known = _known(session, what, search, engine_version)
        if SIZES & set(names) and not SIZES & search:  # only of the rows that are shown
            rows = store.list_rows(session, what, ["sieve_analysis_id"], conditions, order, limit, known)
            known = replace(known, sizes=_sizes(session, [row[0] for row in rows]))
        return names, store.list_rows(session, what, names, conditions, order, limit, known)


def counted(target: Store, what: str, where: Sequence[str] = (), engine_version: int | None = None) -> int:
    """Return how many rows of a list meet the conditions; see ``listed``. Raises ConditionError."""
    kinds = store.column_kinds(what)
    conditions = [tables.parse_condition(text, kinds) for text in where]
    with target.read() as session:
        known = _known(session, what, {condition.column for condition in conditions}, engine_version)
        return store.count_rows(session, what, conditions, known)


def _known(session: Session, what: str, search: Set[str], engine_version: int | None) -> Known:
    """Return what the database needs to be told to search those columns."""
    if engine_version is None and what in ("aggregates", "predictions"):
        engine_version = store.newest_engine(session)
    return Known(_sizes(session) if SIZES & search else (), engine_version or 0)


def _sizes(session: Session, analyses: Sequence[int] | None = None) -> list[tuple[int, float, float, float]]:
    """Return the sizes [mm] that current sieve analyses give, all or those of the ids."""
    sieved = [(row.id, grading.make_grading(sieve_table(row))) for row in store.current_analyses(session, analyses)]
    return [(key, one.apertures[-1], one.apertures[0], grading.equivalent_diameter(one)) for key, one in sieved]
