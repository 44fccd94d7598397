"""One Excel workbook, a sheet for each table: read as typed, and what cannot be is named by its cell."""

import datetime as dt
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from openpyxl import Workbook, load_workbook

from pdlab.errors import TableError
from pdlab.tables import read_path

Book = Callable[..., Path]


@pytest.fixture
def book(tmp_path: Path) -> Book:
    """Write a workbook of sheets by name; ``change`` is called with it before it is saved."""

    def write(change: Callable[[Workbook], None] | None = None, **sheets: list[list[Any]]) -> Path:
        made = Workbook()
        made.remove(made.worksheets[0])
        for title, lines in sheets.items():
            sheet = made.create_sheet(title)
            for line in lines:
                sheet.append(line)
        if change is not None:
            change(made)
        path = tmp_path / "lab.xlsx"
        made.save(path)
        return path

    return write


HEAD = ["aggregate", "aperture_mm", "retained_g", "date"]


def problems(path: Path) -> list[str]:
    return [str(problem) for problem in read_path(path).problems]


def test_a_workbook_reads_as_its_cells_were_typed(book: Book) -> None:
    path = book(
        aggregates=[["name", "delivery", "particle_density_kg_m3", "density_basis"], ["Kies", 7, 2650.123, "oven_dry"]],
        sieves=[HEAD, [None] * 4, ["Kies", "No. 4", 0, dt.date(2026, 3, 31)], ["Kies", 2, "12,5", None]],
        mixtures=[["mixture", "aggregate", "mass_share"], ["M", "Kies", 1]],
    )
    tables = read_path(path)
    assert tables.problems == []
    assert tables.aggregates[0].cells["delivery"] == "7"
    assert tables.aggregates[0].cells["particle_density_kg_m3"] == 2650.123
    record = tables.sieves[0]
    assert [(row.aperture, row.value) for row in record.table.rows] == [(4.75, 0.0), (2.0, 12.5)]
    assert record.raw == ("No. 4\t0", "2\t12,5")
    assert record.date == dt.date(2026, 3, 31)
    assert record.first.line == 3
    assert len(tables.mixtures) == 1


def test_a_number_typed_as_one_is_not_doubted_beside_decimal_commas_but_a_text_is(book: Book) -> None:
    lines = [HEAD[:3], ["A", 16, "0,0"], ["A", 8, 1.234]]
    assert problems(book(sieves=lines)) == []
    assert "'1.234' may be 1234 or 1.234, as" in problems(book(sieves=[*lines[:2], ["A", 8, "1.234"]]))[0]


def test_a_single_sheet_is_told_by_its_header_and_foreign_sheets_are_named(book: Book) -> None:
    mixtures = [["mixture", "aggregate", "mass_share"], ["M", "A", 1]]
    assert len(read_path(book(Tabelle1=mixtures, Tabelle2=[])).mixtures) == 1
    assert problems(book(mixtures=mixtures, Notes=[["to do"]])) == [
        "lab.xlsx, sheet Notes: no table of this name; a workbook's sheets may be aggregates, sieves, "
        "packing_tests, mixtures"
    ]


@pytest.mark.parametrize(
    ("value", "format_", "sentence"),
    [
        ("=1+1", None, "column retained_g: the formula has no value"),
        (0.4, "0.0%", "column retained_g: the cell holds 0.4 and shows 40 %; format it as a number and write 40"),
        ("#DIV/0!", None, "column retained_g: the cell shows the error #DIV/0!"),
        (True, None, "column retained_g: the cell holds TRUE"),
        (dt.datetime(2026, 3, 8), None, "column retained_g: the cell holds the date 2026-03-08"),
        (dt.time(12, 30), None, "column retained_g: the cell holds the time 12:30:00"),
        ("1,240", None, "column retained_g: '1,240' may be 1240 or 1.240"),
    ],
)
def test_what_a_cell_hides_is_named_by_sheet_row_and_column(
    book: Book, value: Any, format_: str | None, sentence: str
) -> None:
    def change(made: Workbook) -> None:
        made["sieves"]["C3"] = value
        if format_ is not None:
            made["sieves"]["C3"].number_format = format_

    found = problems(book(change, sieves=[HEAD, ["A", 16, 0], ["A", 8, None]]))
    assert any(text.startswith(f"lab.xlsx, sheet sieves, row 3, {sentence}") for text in found), found


def test_merged_cells_and_cells_without_a_heading_are_named(book: Book) -> None:
    lines = [HEAD, ["A", 16, 0], [None, 8, 100], ["A", 4, 1, None, "wet"]]
    found = problems(book(lambda made: made["sieves"].merge_cells("A2:A3"), sieves=lines))
    for row in (2, 3):
        assert (
            f"lab.xlsx, sheet sieves, row {row}, column aggregate: the cells A2:A3 are merged; part them"
            in "\n".join(found)
        )
    assert any("row 4: 'wet' stands under no heading" in text for text in found)


def test_a_stray_cell_far_out_is_no_table_of_a_million_rows(book: Book) -> None:
    found = problems(book(lambda made: made["sieves"].cell(1_000_000, 900, "x"), sieves=[HEAD, ["A", 16, 0]]))
    assert "its cells reach to row 1000000 and column 900" in found[0]


def test_a_file_that_is_no_workbook_is_named(book: Book, tmp_path: Path) -> None:
    path = book(sieves=[HEAD, ["A", 16, 0]])
    content = path.read_bytes()
    for broken in (b"", b"PK", content[: len(content) // 2], content[:200] + content[300:]):
        path.write_bytes(broken)
        assert "this is no Excel workbook that can be read" in problems(path)[0]
    assert "the workbook is empty" in problems(book(sieves=[]))[0]
    (tmp_path / "old.xls").touch()
    with pytest.raises(TableError, match=r"'\.xls' cannot be read; save it as \.xlsx"):
        read_path(tmp_path / "old.xls")


def test_a_workbook_in_a_folder_is_not_passed_over(book: Book) -> None:
    assert "a workbook is no table of a folder; import it alone" in problems(book(sieves=[HEAD]).parent)[0]


def test_a_formula_s_stored_value_is_read(book: Book) -> None:
    path = book(sieves=[HEAD[:3], ["A", 16, 0], ["A", 8, 12.5]])
    import zipfile

    with zipfile.ZipFile(path) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    sheet = "xl/worksheets/sheet1.xml"
    parts[sheet] = parts[sheet].replace(b"<v>12.5</v>", b"<f>5*2.5</f><v>12.5</v>")
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in parts.items():
            archive.writestr(name, content)
    assert load_workbook(path)["sieves"]["C3"].value == "=5*2.5"
    tables = read_path(path)
    assert tables.problems == []
    assert tables.sieves[0].table.rows[1].value == 12.5
