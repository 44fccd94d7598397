"""One cell's text → a number, a date, a word. A decimal comma is a decimal point; nothing is guessed."""

import datetime as dt
import math
import re
from collections.abc import Callable

from pdlab.errors import InputError

NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?", re.ASCII)
UNITS = ("kg/m³", "kg/m3", "mm", "g", "%")


class ParseError(InputError):
    """A text that is not the number, date or word that was asked for."""


def parse_number(text: str) -> float:
    """Return the number a text stands for: decimal point or comma, a unit behind it allowed.

    Raises ParseError for anything else, a thousands separator included.
    """
    bare = text.strip()
    for unit in UNITS:
        if bare.endswith(unit):
            bare = bare[: -len(unit)].rstrip()
            break
    if not NUMBER.fullmatch(bare):
        raise ParseError(f"'{text.strip()}' is no number; write it like 12.5 or 12,5, without thousands separators")
    value = float(bare.replace(",", "."))
    if not math.isfinite(value):
        raise ParseError(f"'{text.strip()}' is too large a number; correct it")
    return value


def parse_integer(text: str) -> int:
    """Return the whole number a text stands for. Raises ParseError."""
    value = parse_number(text)
    if value != int(value):
        raise ParseError(f"'{text.strip()}' is no whole number; correct it")
    return int(value)


def number_above_zero(text: str) -> float:
    """Return the positive number a text stands for. Raises ParseError."""
    value = parse_number(text)
    if not value > 0.0:
        raise ParseError(f"{value:g} must be above 0; correct it")
    return value


def percent_below_100(text: str) -> float:
    """Return the number in [0, 100) that a text stands for. Raises ParseError."""
    value = parse_number(text)
    if not 0.0 <= value < 100.0:
        raise ParseError(f"{value:g} % must lie in [0, 100); correct it")
    return value


def parse_date(text: str) -> dt.date:
    """Return the date written as YYYY-MM-DD. Raises ParseError."""
    try:
        return dt.date.fromisoformat(text.strip())
    except ValueError as error:
        raise ParseError(f"'{text.strip()}' is no date; write it like 2026-03-31") from error


def parse_aperture(text: str) -> float | None:
    """Return an aperture [mm], None for the pan. Raises ParseError."""
    return None if text.strip().lower() == "pan" else parse_number(text)


def word_of(*allowed: str) -> Callable[[str], str]:
    """Return a parser that takes only the words of a vocabulary."""

    def parse(text: str) -> str:
        if text.strip() not in allowed:
            raise ParseError(f"'{text.strip()}' is none of {', '.join(allowed)}; use one of them")
        return text.strip()

    return parse


def parse_text(text: str) -> str:
    """Return the text without the blanks around it."""
    return text.strip()
