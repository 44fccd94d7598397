"""A sieve table as typed or pasted on the page → rows, each with its error beside it."""

import re
from dataclasses import dataclass

from pdlab.grading import SieveRow, SieveTable, check
from pdlab.tables.cells import ParseError, decimal_comma, parse_number, refuse_dotted
from pdlab.tables.designations import BLANK_INSIDE, parse_aperture
from pdlab.tables.layout import SIEVE_UNITS


@dataclass(frozen=True)
class PastedRow:
    """A line of a pasted sieve table: its number from 1, its text, what it says, or what is wrong."""

    line: int
    text: str
    row: SieveRow | None
    error: str | None = None


def split_pasted(line: str) -> tuple[str, str]:
    """Return the aperture's and the value's text of a pasted line, parted by tab, semicolon or blanks.

    Raises ParseError when there are not two.
    """
    bare = line.strip()
    named = BLANK_INSIDE.match(bare)
    name, rest = (named.group(), bare[named.end() :].lstrip(" ;\t")) if named else ("", bare)
    joined = re.sub(r"(?<=\d) +(?=([µμu]m|mm|g|%)(\s|;|$))", "", rest)  # a unit belongs to its number
    cells = [name] * bool(name) + re.split(r"\s*[;\t]\s*|\s+", joined)
    if len(cells) != 2:
        raise ParseError(
            f"{len(cells)} values in this line; write an aperture in mm and one value, such as '31,5  120'"
        )
    return cells[0], cells[1]


def read_pasted(text: str, kind: str) -> list[PastedRow]:
    """Read a sieve table as typed or pasted: an aperture (or pan) and a value of ``kind`` in each line."""
    out, comma = [], decimal_comma(re.split(r"[\s;]+", text))
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip():
            continue
        try:
            aperture, value = split_pasted(line)
            refuse_dotted(aperture, comma)
            refuse_dotted(value, comma)
            row = SieveRow(parse_aperture(aperture), parse_number(value, SIEVE_UNITS[kind]))
            out.append(PastedRow(number, line, row))
        except ParseError as error:
            out.append(PastedRow(number, line, None, str(error)))
    return out


def check_pasted(
    rows: list[PastedRow], kind: str, sample_mass: float | None = None, pan_lower: float | None = None
) -> tuple[SieveTable | None, list[PastedRow], list[str]]:
    """Check a pasted table: return it when sound, its rows with their errors, the table's own errors."""
    if any(row.error for row in rows):
        return None, rows, []
    table = SieveTable(tuple(row.row for row in rows if row.row), kind, sample_mass, pan_lower)
    wrong = check(table)
    of_rows = {error.row: str(error) for error in wrong if error.row is not None}
    marked = [PastedRow(row.line, row.text, row.row, of_rows.get(k)) for k, row in enumerate(rows)]
    return (None if wrong else table), marked, [str(error) for error in wrong if error.row is None]
