"""A sieve's designation → its aperture: millimetres, micrometres, ASTM numbers and inches, the pan.

Numbers and inches name the standard apertures of ASTM E11, table 1, they do not measure them. The table is from memory
of the standard: check it against your copy.
"""

import re
from fractions import Fraction

from pdlab.tables.cells import ParseError, parse_number

NUMBERED = {
    "3 1/2": 5.6, "4": 4.75, "5": 4.0, "6": 3.35, "7": 2.8, "8": 2.36, "10": 2.0, "12": 1.7, "14": 1.4, "16": 1.18,
    "18": 1.0, "20": 0.85, "25": 0.71, "30": 0.6, "35": 0.5, "40": 0.425, "45": 0.355, "50": 0.3, "60": 0.25,
    "70": 0.212, "80": 0.18, "100": 0.15, "120": 0.125, "140": 0.106, "170": 0.09, "200": 0.075, "230": 0.063,
    "270": 0.053, "325": 0.045, "400": 0.038, "450": 0.032, "500": 0.025, "635": 0.02,
}  # fmt: skip
"""Apertures [mm] of the sieves that are named by a number."""
INCHES = {
    "5": 125.0, "4.24": 106.0, "4": 100.0, "3 1/2": 90.0, "3": 75.0, "2 1/2": 63.0, "2.12": 53.0, "2": 50.0,
    "1 3/4": 45.0, "1 1/2": 37.5, "1 1/4": 31.5, "1.06": 26.5, "1": 25.0, "7/8": 22.4, "3/4": 19.0, "5/8": 16.0,
    "0.530": 13.2, "1/2": 12.5, "7/16": 11.2, "3/8": 9.5, "5/16": 8.0, "0.265": 6.7, "1/4": 6.3,
}  # fmt: skip
"""Apertures [mm] of the sieves that are named by inches."""
SIZE = r"(\d+[ -]+\d+/\d+|\d+/\d+|\d+(?:[.,]\d*)?|[.,]\d+)"
NUMBER_NAME = re.compile(rf"(?:no\b\.?|#)\s*{SIZE}", re.ASCII | re.IGNORECASE)
INCH_NAME = re.compile(rf"{SIZE}\s*(?:inch(?:es)?|in\b\.?|\"|”|″|'')", re.IGNORECASE | re.ASCII)
MICRO_NAME = re.compile(r"(\S+)\s*[µμu]m", re.IGNORECASE)
PAN = ("pan", "bottom")
BLANK_INSIDE = re.compile(rf"{NUMBER_NAME.pattern}|{INCH_NAME.pattern}", re.ASCII | re.IGNORECASE)
"""The designations that may hold blanks, as they stand at the beginning of a line."""


def parse_aperture(text: str) -> float | None:
    """Return the aperture [mm] that a sieve's designation stands for, None for the pan. Raises ParseError."""
    bare, form = text.strip(), "write millimetres (12.5) or a sieve's name (No. 4, 3/8 in, 63 µm, pan)"
    if not bare:
        raise ParseError(f"the row has no sieve; {form}")
    if bare.lower() in PAN:
        return None
    if numbered := NUMBER_NAME.fullmatch(bare):
        return _standard(bare, numbered[1], NUMBERED, "No. {}")
    if inches := INCH_NAME.fullmatch(bare):
        return _standard(bare, inches[1], INCHES, "{} in")
    if micro := MICRO_NAME.fullmatch(bare):
        return parse_number(micro[1]) / 1000.0
    try:
        return parse_number(bare, "mm")
    except ParseError as error:
        if "may be" in str(error) or "too large" in str(error):
            raise
        raise ParseError(f"'{bare}' is no number; {form}") from error


def _value(size: str) -> Fraction:
    """Return the number that a designation names: 1 1/2, 1-1/2, 3/8, 0.5 or 0,5."""
    parts = re.split("[ -]+", size.replace(",", "."))
    return sum((Fraction(part) for part in parts), Fraction(0))


def _standard(text: str, size: str, known: dict[str, float], form: str) -> float:
    """Return the aperture [mm] of a named sieve; name the nearest ones where the standard has none."""
    values = {_value(name): name for name in known}
    try:
        wanted = _value(size)
    except (ZeroDivisionError, ValueError) as error:  # 1/0, or more digits than Python reads
        raise ParseError(f"'{text}' is no sieve's name; write it like {form.format('4')}") from error
    if wanted in values:
        return known[values[wanted]]
    nearest = sorted(sorted(values, key=lambda value: abs(value - wanted))[:2])
    names = " and ".join(form.format(values[value]) + f" ({known[values[value]]:g} mm)" for value in nearest)
    raise ParseError(f"'{text}' is no sieve of ASTM E11; the nearest are {names}: use one, or write millimetres")
