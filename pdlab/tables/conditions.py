"""What a list is asked for as text: conditions like ``packing_density>0.6``, columns, an order."""

import datetime as dt
import re
from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

from pdlab.errors import ConditionError
from pdlab.tables.cells import ParseError, parse_date, parse_number

CONDITION = re.compile(r"\s*(\w+)\s*(!=|<=|>=|=|<|>|~)(.*)", re.DOTALL)
PARSERS: dict[type, Callable[[str], str | float | dt.date]] = {str: str, float: parse_number, dt.date: parse_date}
VALUES = {str: "text", float: "a number", dt.date: "a day"}


class Condition(NamedTuple):
    """A column, one of ``= != < <= > >= ~`` (contains), and the value it is compared with, None for missing."""

    column: str
    comparison: str
    value: str | float | dt.date | None


def check_columns(names: Iterable[str], kinds: Mapping[str, type]) -> None:
    """Raise ConditionError for a name that is no column of the list whose ``kinds`` these are."""
    for name in names:
        if name not in kinds:
            raise ConditionError(f"'{name}' is no column of this list; use one of {', '.join(kinds)}")


def parse_condition(text: str, kinds: Mapping[str, type]) -> Condition:
    """Return the condition that a text stands for.

    ``kinds``: the list's columns, each with str, float or dt.date, the kind of its values. An empty value
    means missing. Raises ConditionError.
    """
    found = CONDITION.fullmatch(text)
    if not found:
        raise ConditionError(f"'{text}' is no condition; write a column, one of = != < <= > >= ~, and a value")
    column, comparison, value = found[1], found[2], found[3].strip()
    check_columns([column], kinds)
    kind = kinds[column]
    if comparison == "~" and kind is not str:
        raise ConditionError(f"'{text}' searches for text, but {column} holds {VALUES[kind]}; use = != < <= > >=")
    if not value:
        if comparison not in ("=", "!="):
            raise ConditionError(f"'{text}' has no value; give one, or write {column}= for those where it is missing")
        return Condition(column, comparison, None)
    try:
        return Condition(column, comparison, PARSERS[kind](value))
    except ParseError as error:
        raise ConditionError(f"{column} holds {VALUES[kind]}: {error}") from error


def parse_order(text: str, kinds: Mapping[str, type]) -> list[tuple[str, bool]]:
    """Return the columns to sort by, each with whether its values fall: ``state,-seconds``.

    Raises ConditionError.
    """
    order = [(part.strip().removeprefix("-"), part.strip().startswith("-")) for part in text.split(",") if part.strip()]
    check_columns([column for column, _ in order], kinds)
    return order
