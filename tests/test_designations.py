"""Sieves by their names: each is one aperture of ASTM E11, or is refused with the nearest ones."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pdlab.tables import ParseError, parse_aperture, read_cells, split_lines
from pdlab.tables.designations import INCHES, NUMBERED


@pytest.mark.parametrize(
    ("text", "aperture"),
    [
        ("No. 4", 4.75), ("No.200", 0.075), ("no 16", 1.18), ("#8", 2.36), ("# 30", 0.6), ("No. 3-1/2", 5.6),
        ("3/8 in", 9.5), ('3/8"', 9.5), ("1 1/2 in.", 37.5), ("1-1/2 inch", 37.5), ("1.5 in", 37.5), ("2 in", 50.0),
        ("0,5 in", 12.5), ("0.530 in.", 13.2), ("63 µm", 0.063), ("63 μm", 0.063), ("75um", 0.075),
        ("0.063 mm", 0.063), ("31,5", 31.5), ("Pan", None), (" pan ", None), ("bottom", None),
    ],
)  # fmt: skip
def test_a_designation_is_its_standard_aperture(text: str, aperture: float | None) -> None:
    assert parse_aperture(text) == aperture


def test_the_apertures_of_the_standard_fall_as_its_numbers_rise_and_its_inches_fall() -> None:
    for column in (NUMBERED, INCHES):
        apertures = list(column.values())
        assert apertures == sorted(set(apertures), reverse=True)
    assert all(abs(parse_aperture(f"{name} in") or 0.0) == aperture for name, aperture in INCHES.items())
    assert all(parse_aperture(f"No. {name}") == aperture for name, aperture in NUMBERED.items())


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("No. 9", r"'No\. 9' is no sieve of ASTM E11; the nearest are No\. 8 \(2\.36 mm\) and No\. 10 \(2 mm\)"),
        ("#201", r"No\. 200 \(0\.075 mm\)"),
        ("1 1/8 in", r"the nearest are 1\.06 in \(26\.5 mm\) and 1 1/4 in \(31\.5 mm\)|1 in"),
        ("1/0 in", "is no sieve's name"),
        ("No. " + "9" * 5000, "is no sieve's name"),
        ("3/8", "is no number; write millimetres"),
        (" ", r"^the row has no sieve; write millimetres \(12\.5\)"),
        ("sixteen", "is no number; write millimetres"),
        ("1,180", "may be 1180 or 1.180"),
        ("", "the row has no sieve"),
    ],
)
def test_what_is_no_sieve_is_refused_and_the_nearest_are_named(text: str, sentence: str) -> None:
    with pytest.raises(ParseError, match=sentence):
        parse_aperture(text)


@pytest.mark.parametrize("between", ["\t", "; ", "  "])
def test_a_pasted_line_keeps_a_name_with_blanks_together(between: str) -> None:
    names = {"No. 4": 4.75, "1 1/2 in.": 37.5, '3/8 "': 9.5, "No. 3 1/2": 5.6, "63 µm": 0.063, "4 mm": 4.0}
    rows = read_cells(split_lines("\n".join(f"{name}{between}120 g" for name in names)), "retained_g")
    assert [(row.row.aperture, row.row.value) for row in rows if row.row] == [(mm, 120.0) for mm in names.values()]


def test_a_pasted_dotted_number_beside_decimal_commas_is_refused() -> None:
    rows = read_cells(split_lines("31,5 0\n16 1.240\n8 12.5"), "retained_g")
    assert [row.error is None for row in rows] == [True, False, True]
    assert "'1.240' may be 1240 or 1.240, as '31,5' in this table has a decimal comma; write 1240 or 1.2400" in (
        rows[1].error or ""
    )
    assert all(row.error is None for row in read_cells(split_lines("31.5 0\n16 1.240"), "retained_g"))


@given(st.text(max_size=40) | st.from_regex(r"(No\. ?|#)?[0-9 /.,-]{0,9} ?(in|µm|mm|\")?", fullmatch=True))
def test_any_text_is_an_aperture_or_a_named_error(text: str) -> None:
    try:
        aperture = parse_aperture(text)
    except ParseError:
        return
    assert aperture is None or isinstance(aperture, float)
