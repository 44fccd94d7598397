"""What the lists show of aggregates, mixtures, runs and predictions: under conditions, in an order, so many rows.

All of it is left to the database, so that a page of a large store costs little (docs/performance.md).
"""

import datetime as dt
import operator
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa
from sqlalchemy.orm import Session

from pdlab.calibration import REPOSE
from pdlab.density import DEFAULT_ERROR
from pdlab.models import (
    Aggregate,
    Comparison,
    Correction,
    Mixture,
    MixtureComponent,
    PackingTest,
    Run,
    UtcDateTime,
)

Column = sa.ColumnElement[Any]
Columns = Mapping[str, Column]
Row = tuple[Any, ...]
Value = str | float | dt.date | None
Condition = tuple[str, str, Value | Sequence[Value]]
"""A column, one of = != < <= > >= ~ (contains), and a value, None for missing; points in time go by their day, UTC.

Or ``in`` and the values of which it is one; or ``mixture_id``, ``holds`` and names of aggregates, one or more of which
the mixture holds.
"""

SHOWN = {
    "aggregates": (
        "aggregate", "delivery", "finest_mm", "coarsest_mm", "diameter_mm", "packing_density", "friction",
        "friction_low", "friction_high", "rolling_friction", "message",
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


def _view(name: str, /, **kinds: Any) -> sa.TableClause:
    return sa.table(name, *(sa.column(column, kind) for column, kind in kinds.items()))


CURRENT = _view(
    "current_aggregates", aggregate_id=sa.Integer, name=sa.Text, delivery=sa.Text, source=sa.Text, shape=sa.Text,
    oven_dry_density_kg_m3=sa.Float, sieve_analysis_id=sa.Integer, finest_mm=sa.Float, coarsest_mm=sa.Float,
    log_mean_mm=sa.Float, compaction=sa.Text, measured_packing_density=sa.Float, calibration_id=sa.Integer,
    method=sa.Text, diameter_rule=sa.Text, friction=sa.Float, friction_low=sa.Float, friction_high=sa.Float,
    rolling_friction=sa.Float, rolling_friction_low=sa.Float, rolling_friction_high=sa.Float,
    engine_version=sa.Integer, message=sa.Text, created_at=UtcDateTime,
)  # fmt: skip
PAIRS: sa.Table = Comparison.__table__  # type: ignore[assignment]
PAIR_KEY = ("mixture_id", "prediction_id")
OF_TEST = {"tested", "measured_error"}
"""Columns of the predictions that the mixtures' density tests are read for."""


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


def _aggregates(engine_version: int) -> _List:
    named = {"aggregate": "name", "diameter_mm": "log_mean_mm", "packing_density": "measured_packing_density"}
    columns: dict[str, Column] = {name: CURRENT.c[column] for name, column in named.items()}
    columns |= {column.key: column for column in CURRENT.c if column.key not in named.values()}
    columns["message"] = sa.func.coalesce(
        sa.func.nullif(CURRENT.c.message, ""), _older(CURRENT.c.engine_version, engine_version), type_=sa.Text
    )
    return _List(CURRENT, columns, (CURRENT.c.aggregate_id,))


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


def _older(of_result: Column, engine_version: int) -> Column:
    """Return what to say of a result of an older engine; missing where it is none."""
    text = (
        sa.literal("by an older engine (version ") + sa.cast(of_result, sa.Text) + sa.literal("); run 'pdlab refresh'")
    )
    return sa.case((of_result < engine_version, text))


def _predictions(names: Collection[str], engine_version: int) -> _List:
    older = (PAIRS.c.state == "done") & (PAIRS.c.engine_version < engine_version)
    columns: dict[str, Column] = {"packing_density": PAIRS.c.predicted}
    columns |= {column.key: column for column in PAIRS.c if column.key not in ("predicted", "warnings", "outdated")}
    columns["method"] = sa.func.nullif(PAIRS.c.method, "", type_=sa.Text)
    columns["state"] = sa.case((older, "outdated"), else_=PAIRS.c.state)
    columns["message"] = _message(engine_version)
    source: sa.FromClause = PAIRS
    if "expected_error" in names:
        spread = _spread().cte("spread")
        same = (spread.c.method == PAIRS.c.method) & spread.c.engine_version.is_not_distinct_from(
            PAIRS.c.engine_version
        )
        source = source.outerjoin(spread, same)
        columns["expected_error"] = _expected_error(spread)
    if not OF_TEST.isdisjoint(names):
        test = PackingTest.__table__
        source = source.outerjoin(test, _is_newest(test))
        columns |= {"tested": _tested(test), "measured_error": _measured_error(test)}
    return _List(source, columns, (PAIRS.c.mixture_id, PAIRS.c.prediction_id))


def _is_newest(test: sa.FromClause) -> Column:
    """Return whether a density test is the current one of the mixture; looked up for each, a join of all is slow."""
    other = PackingTest.__table__.alias("other")
    newest = sa.select(sa.func.max(other.c.id)).where(other.c.mixture_id == PAIRS.c.mixture_id)
    return test.c.id == newest.correlate(PAIRS).scalar_subquery()


def _tested(test: sa.FromClause) -> Column:
    """Return the day of a density test or, where that is not said, the day when it was entered."""
    return sa.func.coalesce(test.c.date, sa.func.date(test.c.created_at, type_=sa.Date), type_=sa.Date)


def _measured_error(test: sa.FromClause) -> Column:
    """Return the standard error of the measured packing density [-], as ``density.measured_packing`` has it."""
    bulk = test.c.bulk_density_kg_m3
    in_voids = sa.case((test.c.voids_percent.is_not(None), 0.01), else_=1.0)
    scale = sa.case((bulk.is_not(None), PAIRS.c.measured / bulk), else_=in_voids)
    repeats = sa.type_coerce(sa.func.coalesce(test.c.repeats, 1), sa.Double)
    stated = test.c.standard_deviation * scale / sa.func.sqrt(repeats, type_=sa.Float)
    return sa.case((PAIRS.c.measured.is_not(None), sa.func.coalesce(stated, DEFAULT_ERROR, type_=sa.Float)))


def _tested_otherwise() -> Column:
    """Return whether a mixture was tested in another compaction than its beds: the difference is not the method's."""
    stated = (PAIRS.c.compaction != "unstated") | (PAIRS.c.method == REPOSE)
    return sa.func.coalesce(stated & (PAIRS.c.compaction != PAIRS.c.simulated), sa.false(), type_=sa.Boolean)


def _own_difference() -> Column:
    """Return the difference that tells of a method; missing where the mixture was tested otherwise."""
    return sa.case((sa.not_(_tested_otherwise()), PAIRS.c.difference))


def _spread() -> sa.Select[Any]:
    """Return how many differences tell of each method and engine, and the sum of their squares."""
    group, own = (PAIRS.c.method, PAIRS.c.engine_version), _own_difference()
    count, squares = sa.func.count(own), sa.func.sum(own * own)
    return sa.select(*group, count.label("number"), squares.label("squares")).group_by(*group)


def _expected_error(spread: sa.FromClause) -> Column:
    """Return the simulation's error, the inputs' and, from two other comparisons on, their RMS difference."""
    difference = _own_difference()
    count = spread.c.number - sa.case((difference.is_not(None), 1), else_=0)
    squares = spread.c.squares - sa.func.coalesce(difference * difference, 0.0)
    own = sa.case(((count >= 2) & (squares > 0.0), squares / count), else_=0.0)
    errors = (sa.func.coalesce(PAIRS.c[name], 0.0) for name in ("standard_error", "input_error"))
    whole = sum((error * error for error in errors), own)
    return sa.case((PAIRS.c.predicted.is_not(None), sa.func.sqrt(whole, type_=sa.Float)))


def _message(engine_version: int) -> Column:
    """Return what there is to say of a prediction: why there is none, its warnings, what changed since."""
    older = _older(PAIRS.c.engine_version, engine_version)
    of_old_tests = PAIRS.c.outdated + sa.literal(
        ": tested or sieved anew since, or corrected; run 'pdlab predict' again"
    )
    of_old_shares = sa.case(
        ((PAIRS.c.state == "outdated") & older.is_(None), "the mixture was corrected since; run 'pdlab predict' again")
    )
    otherwise = sa.case((
        PAIRS.c.state.in_(("done", "outdated")) & _tested_otherwise(),
        sa.literal("the mixture's density test is ") + PAIRS.c.compaction + sa.literal(", its beds are ")
        + PAIRS.c.simulated + sa.literal(": the difference is of both"),
    ))  # fmt: skip
    notes = (
        PAIRS.c.message,
        sa.func.replace(PAIRS.c.warnings, "\n", "; ", type_=sa.Text),
        sa.func.coalesce(of_old_tests, of_old_shares),
        older,
        otherwise,
    )
    said: Column = sa.literal("")
    for note in notes:
        said = said + sa.func.coalesce(sa.literal("; ") + note, "", type_=sa.Text)
    none_yet = sa.literal("not predicted yet: run 'pdlab predict'")
    nothing = (PAIRS.c.state == "done") & sa.and_(*(note.is_(None) for note in (*notes[:2], older, otherwise)))
    return sa.case((nothing, ""), (PAIRS.c.state == "open", none_yet), else_=sa.func.substr(said, 3, type_=sa.Text))


def _list(what: str, names: Collection[str], engine_version: int) -> _List:
    if what == "aggregates":
        return _aggregates(engine_version)
    if what == "predictions":
        return _predictions(names, engine_version)
    return {"mixtures": _mixtures, "runs": _runs, "corrections": _corrections}[what]()


def column_kinds(what: str) -> dict[str, type]:
    """Return the columns of a list, those shown first, each with str, float or dt.date, the kind of its values."""
    kinds = {str: str, int: float, float: float, dt.datetime: dt.date, dt.date: dt.date}
    columns = _list(what, {*SHOWN[what], *OF_TEST}, 0).columns
    return {name: kinds[columns[name].type.python_type] for name in dict.fromkeys((*SHOWN[what], *columns))}


def list_rows(
    session: Session,
    what: str,
    columns: Sequence[str],
    conditions: Sequence[Condition] = (),
    order: Sequence[tuple[str, bool]] = (),
    limit: int | None = None,
    engine_version: int = 0,
) -> list[Row]:
    """Return a list's ``columns``, row by row.

    ``order``: columns to sort by, each with whether its values fall; texts without regard to case, what is
    missing last. Results of an older engine than ``engine_version`` are outdated.
    """
    if what == "predictions" and limit is not None and tuple(columns) != PAIR_KEY:  # sorting carries no more
        page = list_rows(session, what, PAIR_KEY, conditions, order, limit, engine_version)
        return _of_page(session, page, columns, engine_version)
    found = _list(what, {*columns, *(name for name, *_ in conditions), *(name for name, _ in order)}, engine_version)
    asked = [(_rank(found.columns[name]), falls) for name, falls in order]
    query = (
        sa.select(*(found.columns[name].label(name) for name in columns))
        .select_from(found.source)
        .where(*(_meets(found.columns[name], comparison, value) for name, comparison, value in conditions))
        .order_by(*((rank.desc() if falls else rank.asc()).nulls_last() for rank, falls in asked))
        .order_by(*(() if asked else found.order), *found.key)
        .limit(limit)
    )
    return [tuple(row) for row in session.execute(query).all()]


def _of_page(session: Session, page: Sequence[Row], columns: Sequence[str], engine_version: int) -> list[Row]:
    """Return the columns of a page of predictions, which its keys stand for."""
    found = _predictions(columns, engine_version)
    wanted = (found.columns[name].label(name) for name in (*PAIR_KEY, *columns))
    its = PAIRS.c.mixture_id.in_({row[0] for row in page})
    rows = session.execute(sa.select(*wanted).select_from(found.source).where(its))
    said = {row[:2]: row[2:] for row in rows}
    return [tuple(said[key]) for key in page]


def _rank(column: Column) -> Column:
    """Return what a column is sorted by: texts without regard to case."""
    return sa.func.lower(column) if column.type.python_type is str else column


def count_rows(session: Session, what: str, conditions: Sequence[Condition] = (), engine_version: int = 0) -> int:
    """Return how many rows of a list meet the conditions."""
    found = _list(what, {name for name, *_ in conditions}, engine_version)
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
    "in": lambda column, values: column.in_(values),
    "holds": lambda column, names: column.in_(_holding(names)),
}


def _holding(names: Sequence[str]) -> sa.Select[Any]:
    """Return the mixtures that hold one or more of the aggregates of these names."""
    part, one = MixtureComponent.__table__, Aggregate.__table__
    return sa.select(part.c.mixture_id).join_from(part, one).where(one.c.name.in_(names))


def _meets(column: Column, comparison: str, value: Value | Sequence[Value]) -> Column:
    if value is None:
        missing = sa.func.coalesce(column, "") == "" if column.type.python_type is str else column.is_(None)
        return missing if comparison == "=" else sa.not_(missing)
    if isinstance(value, float):
        return COMPARISONS[comparison](sa.type_coerce(column, sa.Double), value)  # a whole number's column too
    if not isinstance(value, dt.date) or isinstance(column.type, sa.Date):
        return COMPARISONS[comparison](column, value)
    first, last = (dt.datetime.combine(value, time, dt.UTC) for time in (dt.time.min, dt.time.max))
    if comparison in ("=", "!="):
        within = column.between(first, last)
        return within if comparison == "=" else sa.not_(within) | column.is_(None)
    return COMPARISONS[comparison](column, last if comparison in ("<=", ">") else first)


def differences(session: Session) -> dict[tuple[str, int | None], tuple[int, float]]:
    """Return, by method and engine, the number of predictions whose mixture was tested alike and Σ difference²."""
    rows = session.execute(_spread().where(PAIRS.c.difference.is_not(None)))
    return {(row.method, row.engine_version): (row.number, row.squares or 0.0) for row in rows}
