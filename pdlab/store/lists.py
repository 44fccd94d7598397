"""What the lists show of aggregates, mixtures, runs and predictions: under conditions, in an order, so many rows.

All of it is left to the database, so that a page of a large store costs little (docs/performance.md).
"""

import datetime as dt
import operator
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa
from sqlalchemy.orm import Session, selectinload

from pdlab.models import Aggregate, Correction, Mixture, MixtureComponent, Run, SieveAnalysis, UtcDateTime

Column = sa.ColumnElement[Any]
Columns = Mapping[str, Column]
Row = tuple[Any, ...]
Value = str | float | dt.date | None
Condition = tuple[str, str, Value]
"""A column, one of = != < <= > >= ~ (contains), and a value, None for missing; points in time go by their day, UTC."""

SHOWN = {
    "aggregates": (
        "aggregate", "delivery", "finest_mm", "coarsest_mm", "diameter_mm", "packing_density", "friction",
        "friction_low", "friction_high", "message",
    ),
    "mixtures": ("mixture", "aggregate", "solid_volume_share"),
    "runs": (
        "specimen_hash", "state", "spheres", "seed", "packing_density", "coordination_number", "steps", "seconds",
        "rest", "engine_version",
    ),
    "predictions": (
        "mixture", "method", "packing_density", "standard_error", "input_error", "expected_error", "measured",
        "difference", "state", "message",
    ),
    "corrections": ("at", "by", "row", "column", "before", "after", "reason"),
}  # fmt: skip
"""The lists, each with the columns shown where none are asked for."""
SIZES = ("finest_mm", "coarsest_mm", "diameter_mm")
"""Columns of the aggregates that are worked out from the sieve tables and handed in."""


def _view(name: str, /, **kinds: Any) -> sa.TableClause:
    return sa.table(name, *(sa.column(column, kind) for column, kind in kinds.items()))


CURRENT = _view(
    "current_aggregates", aggregate_id=sa.Integer, name=sa.Text, delivery=sa.Text, source=sa.Text, shape=sa.Text,
    oven_dry_density_kg_m3=sa.Float, sieve_analysis_id=sa.Integer, compaction=sa.Text,
    measured_packing_density=sa.Float, calibration_id=sa.Integer, diameter_rule=sa.Text, friction=sa.Float,
    friction_low=sa.Float, friction_high=sa.Float, engine_version=sa.Integer, message=sa.Text,
    created_at=UtcDateTime,
)  # fmt: skip
PAIRS = _view(
    "predicted_vs_measured", mixture_id=sa.Integer, mixture=sa.Text, prediction_id=sa.Integer, state=sa.Text,
    method=sa.Text, engine_version=sa.Integer, predicted=sa.Float, standard_error=sa.Float, input_error=sa.Float,
    compaction=sa.Text, measured=sa.Float, message=sa.Text, warnings=sa.Text, requested_at=UtcDateTime,
)  # fmt: skip
OUTDATED = _view("outdated_calibrations", calibration_id=sa.Integer, aggregate=sa.Text)
PAIR_KEY = ("mixture_id", "prediction_id")
COSTLY = ("state", "message", "warnings", "compaction", "requested_at")
"""Columns of predictions that a page is better sorted without."""
SOURCES = _view("prediction_calibration", prediction_id=sa.Integer, calibration_id=sa.Integer)


@dataclass(frozen=True)
class Known:
    """What the database cannot tell of itself.

    ``sizes``: the ids of the sieve analyses to be shown, each with its finest size, coarsest size and equivalent
    diameter [mm]; ``engine_version``: results of older ones are outdated.
    """

    sizes: Sequence[tuple[int, float, float, float]] = ()
    engine_version: int = 0


NOTHING = Known()


@dataclass(frozen=True)
class _List:
    """Where a list's rows come from, its columns by name, its key, and its order where none is asked for.

    The key sorts in the end. That of the runs rises with time, as they are stored: SQLite sorts rows that
    come in falling order anew with each.
    """

    source: sa.FromClause
    columns: Columns
    key: tuple[Column, ...]
    order: tuple[Column, ...] = ()


def _aggregates(known: Known) -> _List:
    header = (sa.column("id", sa.Integer), *(sa.column(name, sa.Float) for name in SIZES))
    table = sa.values(*header, literal_binds=True).data(list(known.sizes) or [(0, 0.0, 0.0, 0.0)]).cte("sizes")
    columns: dict[str, Column] = {"aggregate": CURRENT.c.name, "packing_density": CURRENT.c.measured_packing_density}
    columns |= {name: table.c[name] for name in SIZES}
    columns |= {column.key: column for column in CURRENT.c if column.key not in ("name", "measured_packing_density")}
    columns["message"] = sa.func.coalesce(
        sa.func.nullif(CURRENT.c.message, ""), _older(CURRENT.c.engine_version, known), type_=sa.Text
    )
    source = CURRENT.outerjoin(table, table.c.id == CURRENT.c.sieve_analysis_id)
    return _List(source, columns, (CURRENT.c.aggregate_id,))


def _mixtures() -> _List:
    blend, part, one = Mixture.__table__, MixtureComponent.__table__, Aggregate.__table__
    columns = {"mixture": blend.c.name, "aggregate": one.c.name, "delivery": one.c.delivery}
    columns |= {name: part.c[name] for name in ("solid_volume_share", "mass_share")}
    return _List(part.join(blend).join(one), columns, (part.c.mixture_id, part.c.position))


def _runs() -> _List:
    table = Run.__table__
    others = (
        "finished_at",
        "created_at",
        "repose_angle_deg",
        "height",
        "largest_overlap",
        "numba_version",
        "processor",
        "warnings",
        "error",
    )
    columns = {name: table.c[name] for name in (*SHOWN["runs"], *others)}
    order = (table.c.finished_at.desc().nulls_last(),)
    return _List(table, columns, (table.c.finished_at, table.c.specimen_hash), order)


def _corrections() -> _List:
    table = Correction.__table__
    row = table.c.table_name + sa.literal(":") + table.c.row_key
    names = {"at": "corrected_at", "by": "corrected_by", "column": "column_name", "before": "old_value"}
    columns = {key: table.c[name] for key, name in (names | {"after": "new_value", "reason": "reason"}).items()}
    return _List(table, columns | {"row": row}, (table.c.id,))


def _older(engine_version: Column, known: Known) -> Column:
    """Return what to say of a result of an older engine; missing where it is none."""
    text = sa.literal("of engine version ") + sa.cast(engine_version, sa.Text) + sa.literal("; run 'pdlab refresh'")
    return sa.case((engine_version < known.engine_version, text))


def _predictions(names: Collection[str], known: Known) -> _List:
    wanted = {*names, *(("state", "warnings") if "message" in names else ())}
    given = [column for column in PAIRS.c if column.key not in COSTLY or column.key in wanted]
    # the expected error rests on all rows: what the view gives once is then read twice
    pairs = _once(*given) if "expected_error" in names else sa.select(*given).subquery("pairs")
    difference = pairs.c.predicted - pairs.c.measured
    columns: dict[str, Column] = {"packing_density": pairs.c.predicted, "difference": difference}
    columns |= {column.key: column for column in pairs.c if column.key not in ("predicted", "warnings")}
    source: sa.FromClause = pairs
    if "state" in wanted:
        older = (pairs.c.state == "done") & (pairs.c.engine_version < known.engine_version)
        columns["state"] = sa.case((older, "outdated"), else_=pairs.c.state)
    if "message" in wanted:
        columns["message"] = _message(pairs, known)
    if "expected_error" in wanted:
        spread = _spread(pairs).cte("spread")
        same = (spread.c.method == pairs.c.method) & (spread.c.engine_version == pairs.c.engine_version)
        source = pairs.outerjoin(spread, same)
        columns["expected_error"] = _expected_error(pairs, spread, difference)
    return _List(source, columns, (pairs.c.mixture_id, pairs.c.prediction_id))


def _once(*columns: Column) -> sa.CTE:
    """Return columns of the view of predictions that the database is to work out once for each row."""
    return sa.select(*columns).cte("pairs").prefix_with("MATERIALIZED")


def _spread(pairs: sa.FromClause) -> sa.Select[Any]:
    """Return how many differences there are by method and engine, and the sum of their squares."""
    difference = pairs.c.predicted - pairs.c.measured
    group = (pairs.c.method, pairs.c.engine_version)
    count, squares = sa.func.count(difference), sa.func.sum(difference * difference)
    return sa.select(*group, count.label("number"), squares.label("squares")).group_by(*group)


def _expected_error(pairs: sa.FromClause, spread: sa.FromClause, difference: Column) -> Column:
    """Return the simulation's error, the inputs' and, from two other comparisons on, their RMS difference."""
    count = spread.c.number - sa.case((difference.is_not(None), 1), else_=0)
    squares = spread.c.squares - sa.func.coalesce(difference * difference, 0.0)
    own = sa.case(((count >= 2) & (squares > 0.0), squares / count), else_=0.0)
    errors = (sa.func.coalesce(pairs.c[name], 0.0) for name in ("standard_error", "input_error"))
    whole = sum((error * error for error in errors), own)
    return sa.case((pairs.c.predicted.is_not(None), sa.func.sqrt(whole, type_=sa.Float)))


def _message(pairs: sa.FromClause, known: Known) -> Column:
    """Return what there is to say of a prediction: why there is none, its warnings, what changed since."""
    names = (
        sa.select(sa.func.aggregate_strings(OUTDATED.c.aggregate, ", "))
        .select_from(SOURCES.join(OUTDATED, SOURCES.c.calibration_id == OUTDATED.c.calibration_id))
        .where(SOURCES.c.prediction_id == pairs.c.prediction_id)
        .scalar_subquery()
    )
    older = _older(pairs.c.engine_version, known)
    of_old_tests = names + sa.literal(": tested or sieved anew since, or corrected; run 'pdlab predict' again")
    of_old_shares = sa.case(
        ((pairs.c.state == "outdated") & older.is_(None), "the mixture was corrected since; run 'pdlab predict' again")
    )
    notes = (
        pairs.c.message,
        sa.func.replace(pairs.c.warnings, "\n", "; ", type_=sa.Text),
        # names cost most: not asked for where nothing is outdated
        sa.case((pairs.c.state.in_(("outdated", "failed")), sa.func.coalesce(of_old_tests, of_old_shares))),
        older,
    )
    said: Column = sa.literal("")
    for note in notes:
        said = said + sa.func.coalesce(sa.literal("; ") + note, "", type_=sa.Text)
    none_yet = sa.literal("not predicted yet: run 'pdlab predict'")
    return sa.case((pairs.c.state == "open", none_yet), else_=sa.func.substr(said, 3, type_=sa.Text))


def _list(what: str, names: Collection[str], known: Known) -> _List:
    if what == "aggregates":
        return _aggregates(known)
    if what == "predictions":
        return _predictions(names, known)
    return {"mixtures": _mixtures, "runs": _runs, "corrections": _corrections}[what]()


def column_kinds(what: str) -> dict[str, type]:
    """Return the columns of a list, those shown first, each with str, float or dt.date, the kind of its values."""
    kinds = {str: str, int: float, float: float, dt.datetime: dt.date}
    columns = _list(what, (*SHOWN[what], *COSTLY), Known()).columns
    return {name: kinds[columns[name].type.python_type] for name in dict.fromkeys((*SHOWN[what], *columns))}


def list_rows(
    session: Session,
    what: str,
    columns: Sequence[str],
    conditions: Sequence[Condition] = (),
    order: Sequence[tuple[str, bool]] = (),
    limit: int | None = None,
    known: Known = NOTHING,
) -> list[Row]:
    """Return a list's ``columns``, row by row.

    ``order``: columns to sort by, each with whether its values fall; texts without regard to case, what is
    missing last. ``known``:
    with the sizes where one of SIZES is among the columns.
    """
    search = {*(name for name, *_ in conditions), *(name for name, _ in order)}
    late = [name for name in columns if name in COSTLY and name not in search]
    if what == "predictions" and late and limit is not None:
        early = [*PAIR_KEY, *(name for name in columns if name not in late)]
        page = list_rows(session, what, early, conditions, order, limit, known)
        return _with_late(session, page, early, late, columns, known)
    found = _list(what, {*columns, *search}, known)
    asked = [(_rank(found.columns[name]), falls) for name, falls in order]
    query = (
        sa.select(*(found.columns[name].label(name) for name in columns))
        .select_from(found.source)
        .where(*(_meets(found.columns[name], comparison, value) for name, comparison, value in conditions))
        .order_by(*((rank.desc() if falls else rank.asc()).nulls_last() for rank, falls in asked))
        .order_by(*(() if asked else found.order), *found.key)
        .limit(limit)
    )
    return [tuple(row) for row in session.execute(query)]


def _with_late(
    session: Session, page: list[Row], early: Sequence[str], late: Sequence[str], columns: Sequence[str], known: Known
) -> list[Row]:
    """Return a page of predictions with the columns that are looked up only of the rows in it."""
    found = _predictions(late, known)
    wanted = (found.columns[name].label(name) for name in (*PAIR_KEY, *late))
    query = sa.select(*wanted).where(found.columns["mixture_id"].in_([row[0] for row in page]))
    said = {row[:2]: row[2:] for row in session.execute(query)}
    whole = (dict(zip((*early, *late), (*row, *said[row[:2]]), strict=True)) for row in page)
    return [tuple(row[name] for name in columns) for row in whole]


def _rank(column: Column) -> Column:
    """Return what a column is sorted by: texts without regard to case."""
    return sa.func.lower(column) if column.type.python_type is str else column


def count_rows(session: Session, what: str, conditions: Sequence[Condition] = (), known: Known = NOTHING) -> int:
    """Return how many rows of a list meet the conditions."""
    found = _list(what, {name for name, *_ in conditions}, known)
    query = (
        sa.select(sa.func.count())
        .select_from(found.source)
        .where(*(_meets(found.columns[name], comparison, value) for name, comparison, value in conditions))
    )
    return session.scalar(query) or 0


COMPARISONS: dict[str, Callable[[Column, Any], Column]] = {
    "=": operator.eq,
    "!=": lambda column, value: column.is_distinct_from(value),  # what is missing is different too
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "~": lambda column, value: column.icontains(value, autoescape=True),
}


def _meets(column: Column, comparison: str, value: Value) -> Column:
    if value is None:
        missing = sa.func.coalesce(column, "") == "" if column.type.python_type is str else column.is_(None)
        return missing if comparison == "=" else sa.not_(missing)
    if isinstance(value, float):
        return COMPARISONS[comparison](sa.type_coerce(column, sa.Double), value)  # a whole number's column too
    if isinstance(value, str):
        return COMPARISONS[comparison](column, value)
    first, last = (dt.datetime.combine(value, time, dt.UTC) for time in (dt.time.min, dt.time.max))
    if comparison in ("=", "!="):
        within = column.between(first, last)
        return within if comparison == "=" else sa.not_(within) | column.is_(None)
    return COMPARISONS[comparison](column, last if comparison in ("<=", ">") else first)


def differences(session: Session) -> dict[tuple[str, int | None], tuple[int, float]]:
    """Return, by method and engine, the number of predictions that have a measurement and Σ (their difference)²."""
    rows = session.execute(_spread(_once(PAIRS.c.method, PAIRS.c.engine_version, PAIRS.c.predicted, PAIRS.c.measured)))
    return {(row.method, row.engine_version): (row.number, row.squares) for row in rows if row.squares is not None}


def current_analyses(session: Session, ids: Sequence[int] | None = None) -> list[SieveAnalysis]:
    """Return the sieve analyses of these ids, by default the current one of each aggregate, with their results."""
    wanted = sa.select(CURRENT.c.sieve_analysis_id) if ids is None else ids
    query = sa.select(SieveAnalysis).where(SieveAnalysis.id.in_(wanted))
    return list(session.scalars(query.options(selectinload(SieveAnalysis.results))))
