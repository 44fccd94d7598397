"""What users bring, text → plain records, and back: one format for the shell, Python and the page; no SQL."""

from pdlab.tables.appending import Output
from pdlab.tables.cells import ParseError, Typed, above_zero, parse_integer, parse_number
from pdlab.tables.conditions import Condition, check_columns, parse_condition, parse_order
from pdlab.tables.designations import parse_aperture
from pdlab.tables.files import read_frame, read_frames, read_path
from pdlab.tables.layout import (
    DENSITY_KINDS,
    DENSITY_UNITS,
    LAYOUT,
    SHARE_KINDS,
    MixtureRecord,
    Row,
    SieveRecord,
    Tables,
)
from pdlab.tables.pasted import PastedRow, check_pasted, read_cells, split_lines, split_pasted
from pdlab.tables.sievefiles import SieveSheet, read_sieve_file
from pdlab.tables.slicing import Brought, Slice, Slices, slices, slices_of_frame
from pdlab.tables.writing import check_target, csv_text, write_tables

__all__ = [
    "DENSITY_KINDS",
    "DENSITY_UNITS",
    "LAYOUT",
    "SHARE_KINDS",
    "Brought",
    "Condition",
    "MixtureRecord",
    "Output",
    "ParseError",
    "PastedRow",
    "Row",
    "SieveRecord",
    "SieveSheet",
    "Slice",
    "Slices",
    "Tables",
    "Typed",
    "above_zero",
    "check_columns",
    "check_pasted",
    "check_target",
    "csv_text",
    "parse_aperture",
    "parse_condition",
    "parse_integer",
    "parse_number",
    "parse_order",
    "read_cells",
    "read_frame",
    "read_frames",
    "read_path",
    "read_sieve_file",
    "slices",
    "slices_of_frame",
    "split_lines",
    "split_pasted",
    "write_tables",
]
