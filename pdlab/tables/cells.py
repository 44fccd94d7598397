"""One cell's text → a number, a date, a word. A decimal comma is a decimal point; nothing is guessed."""

import datetime as dt
import math
import re
from collections.abc import Callable, Iterable

from pdlab.errors import InputError

NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?", re.ASCII)
AMBIGUOUS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}", re.ASCII)
DECIMAL_COMMA = re.compile(r"\s*[+-]?(?![1-9]\d{0,2},\d{3}(?!\d))\d*,\d.*", re.ASCII)
DOTTED = re.compile(r"\s*([+-]?[1-9]\d{0,2}\.\d{3})(?![\d.,]).*", re.ASCII)
LARGEST_INTEGER = 1_000_000


class ParseError(InputError):
    """A text that is not the number, date or word that was asked for."""


def parse_number(text: str, *units: str) -> float:
    """Return the number a text stands for: decimal point or comma, one of ``units`` behind it allowed.

    Raises ParseError for anything else: a thousands separator, or what may be one (1,240), too.
    """
    bare = text.strip()
    for unit in units:
        if bare.endswith(unit):
            bare = bare[: -len(unit)].rstrip()
            break
    if not NUMBER.fullmatch(bare):
        like = f" {units[0]}" if units else ""
        raise ParseError(
            f"'{text.strip()}' is no number; write it like 12.5{like} or 12,5{like}, without thousands separators"
        )
    if AMBIGUOUS.fullmatch(bare):
        raise _ambiguous(bare)
    value = float(bare.replace(",", "."))
    if not math.isfinite(value):
        raise ParseError(f"'{text.strip()}' is too large a number; correct it")
    return value


class Typed(str):
    """The text of a number that came as a number, from Excel or a frame: its point is no guess."""

    __slots__ = ()


class Unread(str):
    """In place of a cell's text, the sentence that says why it has none."""

    __slots__ = ()


def decimal_comma(texts: Iterable[str]) -> str | None:
    """Return the first number with a decimal comma among ``texts``, None where there is none."""
    return next((text.strip() for text in texts if DECIMAL_COMMA.fullmatch(text)), None)


def refuse_dotted(text: str, comma: str | None) -> None:
    """Raise ParseError for a number such as 1.240 in a table that has a number with a decimal ``comma``."""
    dotted = DOTTED.fullmatch(text)
    if comma is not None and dotted and not isinstance(text, Typed):
        raise _ambiguous(dotted[1], f", as '{comma}' in this table has a decimal comma")


def _ambiguous(bare: str, reason: str = "") -> ParseError:
    """Return the error of a number such as 1,240; a zero more is no thousands separator to anyone."""
    whole, decimal = re.sub("[.,]", "", bare), bare.replace(",", ".")
    return ParseError(f"'{bare}' may be {whole} or {decimal}{reason}; write {whole} or {decimal}0")


def number(*units: str) -> Callable[[str], float]:
    """Return a parser of numbers that allows ``units`` behind them, and no others."""
    return lambda text: parse_number(text, *units)


def above_zero(*units: str) -> Callable[[str], float]:
    """Return a parser of positive numbers that allows ``units`` behind them."""

    def parse(text: str) -> float:
        value = parse_number(text, *units)
        if not value > 0.0:
            raise ParseError(f"{value:g} must be above 0; correct it")
        return value

    return parse


def parse_integer(text: str) -> int:
    """Return the whole number a text stands for. Raises ParseError."""
    value = parse_number(text)
    if abs(value) > LARGEST_INTEGER or value != int(value):
        raise ParseError(f"'{text.strip()}' is no whole number up to {LARGEST_INTEGER}; correct it")
    return int(value)


def percent_below_100(text: str) -> float:
    """Return the number in [0, 100) that a text stands for. Raises ParseError."""
    value = parse_number(text, "%")
    if not 0.0 <= value < 100.0:
        raise ParseError(f"{value:g} % must lie in [0, 100); correct it")
    return value


def parse_date(text: str) -> dt.date:
    """Return the date written as YYYY-MM-DD. Raises ParseError."""
    try:
        return dt.date.fromisoformat(text.strip())
    except ValueError as error:
        raise ParseError(f"'{text.strip()}' is no date; write it like 2026-03-31") from error


def word_of(*allowed: str) -> Callable[[str], str]:
    """Return a parser that takes only the words of a vocabulary."""

    def parse(text: str) -> str:
        if text.strip() not in allowed:
            raise ParseError(f"'{text.strip()}' is none of {', '.join(allowed)}; use one of them")
        return text.strip()

    return parse


def parse_text(text: str) -> str:
    """Return the text without the blanks around it. Raises ParseError for control characters."""
    bare = text.strip()
    if not all(character.isprintable() for character in bare):
        raise ParseError(f"{bare!r} holds characters that cannot be shown; write it anew")
    return bare
