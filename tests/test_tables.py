"""What users bring: cells, files, frames, pasted text; every problem with its place."""

from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pdlab.errors import TableError
from pdlab.lab import SHIPPED
from pdlab.tables import (
    ParseError,
    check_pasted,
    parse_integer,
    parse_number,
    read_cells,
    read_frame,
    read_path,
    split_lines,
)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("12,5", 12.5),
        ("12.5", 12.5),
        (" 0,063 mm", 0.063),
        ("40 %", 40.0),
        ("1520 kg/m³", 1520.0),
        ("1e3", 1000.0),
        (",5", 0.5),
    ],
)
def test_a_decimal_comma_is_a_decimal_point_and_a_unit_is_left_out(text: str, value: float) -> None:
    assert parse_number(text, "mm", "%", "kg/m³") == value


@pytest.mark.parametrize(
    "text",
    ["", "abc", "1.234,5", "1,234.5", "1,234", "0.6 %", "1 234", "12,5,6", "nan", "inf", "1e999", "--3", "0x10", "٣"],
)
def test_text_that_is_no_number_is_refused_and_named(text: str) -> None:
    with pytest.raises(ParseError, match=r"is no number|too large|may be"):
        parse_number(text)


def problems(path: Path) -> list[str]:
    return [str(problem) for problem in read_path(path).problems]


def test_the_shipped_tables_are_sound_and_equal_to_the_printed_source() -> None:
    tables = read_path(SHIPPED)
    assert tables.problems == []
    source = pd.read_csv(SHIPPED.parent / "feret_coarse_fractions.csv").set_index("fraction")
    voids = {row.cells["material"]: row.cells["voids_percent"] for row in tables.packing_tests}
    for record in tables.sieves:
        printed = source.loc[record.aggregate.removeprefix("pebbles ")]
        limits = [row.aperture for row in record.table.rows]
        assert limits == [printed["passing_ring_mm_converted"], printed["held_by_ring_mm_converted"]]
        assert voids[record.aggregate] == printed["voids_percent_round_pebbles"]
    mixed = pd.read_csv(SHIPPED.parent / "feret_pebble_mixtures.csv")
    wanted = {
        tuple(name for name in "LMF" if row[f"parts_{name}"]): row["voids_percent_as_printed"]
        for _, row in mixed.iterrows()
    }
    found = {
        tuple(name.removeprefix("pebbles ") for name, _ in record.aggregates): voids[record.name]
        for record in tables.mixtures
    }
    assert found == wanted
    assert all(record.shares == (0.5, 0.5) for record in tables.mixtures)


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1"])
def test_separators_and_encodings_read_alike(tmp_path: Path, separator: str, encoding: str) -> None:
    lines = [["aggregate", "aperture_mm", "retained_percent"], ["Kies grün", "31.5", "0"], ["Kies grün", "16", "100"]]
    if separator == ";":
        lines[1][1] = "31,5"
    file = tmp_path / "anything.csv"
    file.write_bytes("\r\n".join(separator.join(line) for line in lines).encode(encoding))
    tables = read_path(file)
    assert tables.problems == []
    assert tables.sieves[0].aggregate == "Kies grün"
    assert tables.sieves[0].table.rows[0].aperture == 31.5
    assert tables.sieves[0].raw[0] == ("31,5\t0" if separator == ";" else "31.5\t0")


def test_every_problem_is_listed_at_once_with_file_row_and_column(folder: Callable[..., Path]) -> None:
    path = folder(
        aggregates="name,particle_density_kg_m3,density_basis\nA,2600,\nB,heavy,oven_dry\n,2600,oven_dry\n",
        sieves="aggregate,aperture_mm,retained_g\nA,16,0\nA,8,x\nB,8,5\nB,4,5\n",
        packing_tests="material,compaction,voids_percent,packing_density\nA,shaken,40,\nA,loose,40,0.6\nA,loose,,\n",
        mixtures="mixture,aggregate,solid_volume_share\nM,A,0.5\nM,B,0.6\nN,A,1.5\nO,A,0.5\nO,A,0.5\n",
    )
    found = problems(path)
    for wanted in (
        "aggregates.csv, row 2, column density_basis: a particle density and its basis go together",
        "aggregates.csv, row 3, column particle_density_kg_m3: 'heavy' is no number",
        "aggregates.csv, row 4, column name: the cell is empty",
        "sieves.csv, row 3, column retained_g: 'x' is no number",
        "sieves.csv, row 4, column aperture_mm: 50 % lie on the coarsest sieve, 8 mm",
        "packing_tests.csv, row 2, column compaction: 'shaken' is none of loose, rodded, vibrated, unstated",
        "packing_tests.csv, row 3: voids_percent and packing_density are filled; fill exactly one",
        "packing_tests.csv, row 4: none is filled; fill exactly one",
        "mixtures.csv, row 2, column solid_volume_share: the shares of mixture 'M' sum to 1.1",
        "mixtures.csv, row 4, column solid_volume_share: share 1.5 lies outside (0, 1]",
        "mixtures.csv, row 5, column aggregate: 'A' stands more than once in mixture 'O'",
    ):
        assert any(text.startswith(wanted) for text in found), (wanted, found)


def test_a_table_with_foreign_or_missing_columns_is_refused(folder: Callable[..., Path]) -> None:
    path = folder(sieves="aggregate,size\nA,16\n")
    found = problems(path)
    assert any("column size: 'size' is no column of sieves.csv" in text for text in found)
    assert any("the column 'aperture_mm' is missing" in text for text in found)


def test_a_path_that_holds_no_table_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TableError, match="holds no table"):
        read_path(tmp_path)
    with pytest.raises(TableError, match="no such file"):
        read_path(tmp_path / "gone.csv")
    (tmp_path / "empty.csv").touch()
    assert "this is no table (it is empty)" in problems(tmp_path / "empty.csv")[0]


def test_a_frame_reads_as_a_file_does() -> None:
    frame = pd.DataFrame({"mixture": ["M", "M"], "aggregate": ["A", "B"], "mass_share": [0.25, 0.75]})
    record = read_frame(frame, "mixtures").mixtures[0]
    assert record.by_mass
    assert record.aggregates == (("A", ""), ("B", ""))
    assert record.shares == (0.25, 0.75)


def test_pasted_lines_take_tabs_semicolons_blanks_units_and_the_pan() -> None:
    rows = read_cells(split_lines("31,5\t0\n16 mm  1.240,0\n\n8;2560\n4 mm 1150 g\nPan 50"), "retained_g")
    assert [row.line for row in rows] == [1, 2, 3, 4, 5]
    assert rows[1].error is not None
    assert "'1.240,0' is no number" in rows[1].error
    values = [(row.row.aperture, row.row.value) for row in rows if row.row]
    assert values == [(31.5, 0.0), (8.0, 2560.0), (4.0, 1150.0), (None, 50.0)]


def test_errors_of_a_pasted_table_stand_beside_their_lines() -> None:
    table, rows, whole = check_pasted(read_cells(split_lines("31,5 0\n8 5\n16 5"), "retained_g"), "retained_g")
    assert table is None
    assert [row.error is None for row in rows] == [True, True, False]
    table, rows, whole = check_pasted(
        read_cells(split_lines("31,5 0\n16 500"), "retained_g"), "retained_g", sample_mass=1000.0
    )
    assert table is None
    assert "50 % off the sample mass" in whole[0]


@given(st.text(max_size=200))
def test_no_pasted_text_breaks_the_reader(text: str) -> None:
    table, _, _ = check_pasted(read_cells(split_lines(text), "retained_g"), "retained_g")
    assert table is None or table.rows


@given(st.text(max_size=300))
def test_no_file_breaks_the_reader(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    file = tmp_path_factory.mktemp("files") / "sieves.csv"
    file.write_text("aggregate,aperture_mm,retained_g\n" + text, encoding="utf-8", newline="")
    read_path(file)


def test_a_decimal_comma_between_commas_is_refused_and_loses_no_digit(folder: Callable[..., Path]) -> None:
    path = folder(
        packing_tests="material,compaction,voids_percent\nA,loose,38,8\nA,loose,38\n",
        sieves="aggregate,aperture_mm,retained_g\nA,31,0,0\nA,16\n",
    )
    found = problems(path)
    assert sum("cells under 3 columns" in text for text in found) == 3
    assert any(text.startswith("packing_tests.csv, row 2: 4 cells under 3 columns") for text in found)
    assert read_path(path).sieves == []


def test_empty_cells_at_the_end_of_a_line_are_no_fault(folder: Callable[..., Path]) -> None:
    tables = read_path(folder(aggregates="name,shape,,\nA,round,,\n,,,\nB,,,\n"))
    assert tables.problems == []
    assert [row.line for row in tables.aggregates] == [2, 4]


def test_rows_are_counted_as_a_spreadsheet_counts_their_lines(folder: Callable[..., Path]) -> None:
    found = problems(folder(aggregates='name,source\nA,"in\nquotes"\n\n,nobody\n'))
    assert found[-1] == "aggregates.csv, row 5, column name: the cell is empty; fill it"


def test_a_column_twice_an_empty_table_and_a_misspelt_file_are_named(folder: Callable[..., Path]) -> None:
    found = problems(
        folder(aggregates="name,name \nA,B\n", sieves="aggregate,aperture_mm,retained_g\n", siefs="x\n1\n")
    )
    assert "aggregates.csv, row 1, column name: the column 'name' stands 2 times; keep one" in found
    assert "sieves.csv: the table is empty; fill it or leave it out" in found
    assert any(text.startswith("siefs.csv: no table of this name") for text in found)


def test_one_unreadable_cell_hides_no_other_fault_of_its_table(folder: Callable[..., Path]) -> None:
    found = problems(folder(sieves="aggregate,aperture_mm,passing_percent\nA,abc,100\nA,-16,90\nA,8,150\n"))
    assert [text.split(":")[0] for text in found] == [
        f"sieves.csv, row {line}, column aperture_mm" for line in (2, 3, 4)
    ]


def test_facts_of_an_analysis_may_stand_in_any_row_but_only_one_of_each(folder: Callable[..., Path]) -> None:
    head = "aggregate,aperture_mm,retained_g,sample_mass_g,pan_lower_mm,date\n"
    tables = read_path(folder(sieves=head + "A,16,0,,,2026-05-01\nA,8,90,,,\nA,pan,60,150,2,\n"))
    assert tables.problems == []
    assert (tables.sieves[0].table.sample_mass, tables.sieves[0].table.pan_lower) == (150.0, 2.0)
    assert str(tables.sieves[0].date) == "2026-05-01"
    found = problems(folder(sieves=head + "A,16,0,510,,\nA,8,500,9000,,\n"))
    assert any("9000.0 here, 510.0 in row 2; one analysis has one sample_mass_g" in text for text in found)
    assert "off the sample mass" in problems(folder(sieves=head + "A,16,0,,,\nA,8,510,5000,,\n"))[0]


def test_two_dates_make_two_analyses_when_every_row_has_one(folder: Callable[..., Path]) -> None:
    head, may, june = "aggregate,aperture_mm,retained_g,date\n", "2026-05-01", "2026-06-01"
    rows = [f"A,{aperture},{mass},{date}\n" for date in (may, june) for aperture, mass in ((16, 0), (8, 50))]
    assert len(read_path(folder(sieves=head + "".join(rows))).sieves) == 2
    assert any("fill date in every row" in text for text in problems(folder(sieves=head + "".join(rows) + "A,4,1,\n")))


def test_shares_of_three_digits_may_be_off_by_rounding(folder: Callable[..., Path]) -> None:
    assert problems(folder(mixtures="mixture,aggregate,mass_share\nM,A,0.5\nM,B,0.499\n")) == []
    assert problems(folder(mixtures="mixture,aggregate,mass_share\nM,A,0.5\nM,B,0.498\n"))


def test_western_european_text_and_control_characters(tmp_path: Path) -> None:
    file = tmp_path / "aggregates.csv"
    file.write_bytes("name\nSand 0–4\n".encode("cp1252"))
    assert read_path(file).aggregates[0].cells["name"] == "Sand 0–4"
    file.write_bytes(b"name\nA\x00B\n")
    assert "cannot be shown" in problems(file)[0]
    file.write_bytes(b"\x81\x8d\xff")
    assert "this is no table" in problems(file)[0]


def test_too_large_a_whole_number_is_refused() -> None:
    with pytest.raises(ParseError, match="no whole number up to"):
        parse_integer("1e300")
