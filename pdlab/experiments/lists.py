"""Lists of what the store holds, as texts ask for them."""

from collections.abc import Sequence
from typing import Any

from sqlalchemy.orm import Session

from pdlab import store, tables
from pdlab.errors import ConditionError
from pdlab.store import Store


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
    with target.read() as session:
        engine = _engine(session, what, engine_version)
        return names, store.list_rows(session, what, names, conditions, order, limit, engine)


def counted(target: Store, what: str, where: Sequence[str] = (), engine_version: int | None = None) -> int:
    """Return how many rows of a list meet the conditions; see ``listed``. Raises ConditionError."""
    kinds = store.column_kinds(what)
    conditions = [tables.parse_condition(text, kinds) for text in where]
    with target.read() as session:
        return store.count_rows(session, what, conditions, _engine(session, what, engine_version))


def _engine(session: Session, what: str, engine_version: int | None) -> int:
    """Return the engine whose results are not outdated."""
    if engine_version is None and what in ("aggregates", "predictions"):
        engine_version = store.newest_engine(session)
    return engine_version or 0
