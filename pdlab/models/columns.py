"""What all tables have in common: names of constraints, kinds of columns, vocabularies."""

import datetime as dt
import math
import operator
from typing import Any, ClassVar

from sqlalchemy import CheckConstraint, DateTime, Dialect, Double, Integer, MetaData, Text, TypeDecorator
from sqlalchemy.orm import DeclarativeBase

NAMING = {
    "ix": "ix_%(table_name)s_%(column_0_N_name)s",
    "uq": "uq_%(table_name)s_%(column_0_N_name)s",
    "ck": "ck_%(table_name)s_%(constraint_name)s",
    "fk": "fk_%(table_name)s_%(column_0_N_name)s_%(referred_table_name)s",
    "pk": "pk_%(table_name)s",
}


class UtcDateTime(TypeDecorator[dt.datetime]):
    """Points in time, stored in UTC without an offset, aware in Python."""

    impl = DateTime
    cache_ok = True
    python_type = dt.datetime

    def process_bind_param(self, value: dt.datetime | None, dialect: Dialect) -> Any:
        """Refuse a naive time; store UTC."""
        if value is None:
            return None
        if value.tzinfo is None:
            raise ValueError(f"{value} has no time zone")
        return value.astimezone(dt.UTC).replace(tzinfo=None)

    def process_result_value(self, value: dt.datetime | None, dialect: Dialect) -> dt.datetime | None:
        """Return an aware time."""
        return None if value is None else value.replace(tzinfo=dt.UTC)


class Number(TypeDecorator[float]):
    """A number, NumPy's too; NaN is stored as NULL, which SQLite would do unasked and PostgreSQL would not."""

    impl = Double
    cache_ok = True
    python_type = float

    def process_bind_param(self, value: float | None, dialect: Dialect) -> float | None:
        """Return a float of Python's own, None for NaN."""
        return None if value is None or math.isnan(value) else float(value)


class Whole(TypeDecorator[int]):
    """A whole number, NumPy's too, which SQLite would keep as bytes."""

    impl = Integer
    cache_ok = True
    python_type = int

    def process_bind_param(self, value: int | None, dialect: Dialect) -> int | None:
        """Return an int of Python's own; refuse what is none."""
        return None if value is None else operator.index(value)


def now() -> dt.datetime:
    """Return the present time in UTC."""
    return dt.datetime.now(dt.UTC)


class Base(DeclarativeBase):
    """Base of all tables."""

    metadata = MetaData(naming_convention=NAMING)
    type_annotation_map: ClassVar[dict[Any, Any]] = {dt.datetime: UtcDateTime, str: Text, float: Number, int: Whole}


def one_of(column: str, values: tuple[str, ...], optional: bool = False) -> CheckConstraint:
    """Allow the values of a vocabulary only, and NULL where ``optional``."""
    allowed = ", ".join(f"'{value}'" for value in values)
    null = f"{column} IS NULL OR " if optional else ""
    return CheckConstraint(f"{null}{column} IN ({allowed})", name=column)


def exactly_one(*columns: str) -> CheckConstraint:
    """Allow rows in which one of the columns is given, and no other."""
    count = " + ".join(f"CASE WHEN {column} IS NULL THEN 0 ELSE 1 END" for column in columns)
    return CheckConstraint(f"{count} = 1", name="one_value")
