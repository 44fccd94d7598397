"""A sieve table as typed into a grid or pasted on the page → rows, each with its error beside it."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from pdlab.grading import SieveRow, SieveTable, check
from pdlab.tables.cells import ParseError, decimal_comma, parse_number, refuse_dotted
from pdlab.tables.designations import BLANK_INSIDE, parse_aperture
from pdlab.tables.layout import SIEVE_UNITS


@dataclass(frozen=True)
class PastedRow:
    """A row of a sieve table as entered: its number from 1, its text, what it says, or what is wrong.

    ``row`` is None where it could not be read, and where the sieve was not used.
    """

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


def split_lines(text: str) -> list[tuple[str, str]]:
    """Return the cells of a pasted text, line by line; a line that has not two stands in the first as it is."""
    out = []
    for line in text.splitlines():
        try:
            out.append(split_pasted(line))
        except ParseError:
            out.append((line.strip(), ""))
    return [cells for cells in out if any(cells)]


def read_cells(cells: Sequence[tuple[str, str]], kind: str) -> list[PastedRow]:
    """Read a sieve table as it stands in a grid: an aperture (or pan) and a value of ``kind`` in each row.

    A sieve without a value was not used: it is no row of the table, and has no error, unless it cannot be read.
    """
    out, comma = [], decimal_comma(text for pair in cells for text in pair)
    for number, (aperture, value) in enumerate(cells, start=1):
        text = f"{aperture.strip()}\t{value.strip()}".rstrip("\t")
        if not text:
            continue
        try:
            refuse_dotted(aperture, comma)
            refuse_dotted(value, comma)
            place = parse_aperture(aperture)
            row = SieveRow(place, parse_number(value, SIEVE_UNITS[kind])) if value.strip() else None
            out.append(PastedRow(number, text, row))
        except ParseError as error:
            out.append(PastedRow(number, text, None, str(error)))
    return out


def check_pasted(
    rows: list[PastedRow], kind: str, sample_mass: float | None = None, pan_lower: float | None = None
) -> tuple[SieveTable | None, list[PastedRow], list[str]]:
    """Check a pasted table: return it when sound, its rows with their errors, the table's own errors."""
    if any(row.error for row in rows):
        return None, rows, []
    used = [row for row in rows if row.row is not None]
    table = SieveTable(tuple(row.row for row in used if row.row), kind, sample_mass, pan_lower)
    wrong = check(table)
    of_rows = {used[error.row].line: str(error) for error in wrong if error.row is not None}
    marked = [PastedRow(row.line, row.text, row.row, of_rows.get(row.line)) for row in rows]
    return (None if wrong else table), marked, [str(error) for error in wrong if error.row is None]
