"""Which rows no sound database would have let in: looked for when something went wrong that they may explain."""

import datetime as dt
from collections.abc import Iterator

import sqlalchemy as sa
from sqlalchemy.orm import Session

from pdlab.models import Base

KINDS = {str: ("text",), int: ("integer",), float: ("real", "integer"), bytes: ("blob",)}
"""How SQLite, which takes anything into any column, keeps the values of a column."""


def damaged_rows(session: Session) -> Iterator[tuple[str, str, str]]:
    """Yield rows that break a rule of their table, the first for each rule: table, key, and what is wrong.

    Rules: the columns' types and whether they may be empty, the CHECK constraints, and that what is named is there.
    """
    for table in Base.metadata.sorted_tables:
        key = [sa.cast(column, sa.Text) for column in table.primary_key]
        for said, broken in _rules(table, session.get_bind().dialect.name):
            for what, *parts in session.execute(sa.select(said, *key).where(broken).limit(1)):
                yield table.name, "/".join(parts), what


def _rules(table: sa.Table, dialect: str) -> Iterator[tuple[sa.ColumnElement[str], sa.ColumnElement[bool]]]:
    """Yield what is to be said of a row, and whether it is so."""
    for column in table.columns:
        said = sa.literal(f"{column.name} '") + sa.func.coalesce(sa.cast(column, sa.Text), "")
        said = said + sa.literal("' is no value for it")
        broken: list[sa.ColumnElement[bool]] = [column.is_(None)] if not column.nullable else []
        if dialect == "sqlite":
            broken.append(_of_other_kind(column))
        for link in column.foreign_keys:
            there = link.column.table.alias()
            broken.append(column.is_not(None) & ~sa.exists().where(there.c[link.column.name] == column))
        if broken:
            yield said, sa.or_(*broken)
    for rule in table.constraints:
        if isinstance(rule, sa.CheckConstraint):
            yield sa.literal(f"it breaks the rule {rule.sqltext}"), sa.text(f"NOT ({rule.sqltext})")  # type: ignore[misc]


def _of_other_kind(column: sa.Column[object]) -> sa.ColumnElement[bool]:
    """Return whether SQLite holds what is no value of a column."""
    kind = column.type.python_type
    if issubclass(kind, dt.date):
        return column.is_not(None) & sa.func.julianday(column, type_=sa.Double).is_(None)
    return sa.func.typeof(column, type_=sa.Text).not_in((*KINDS[kind], "null"))
