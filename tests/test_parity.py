"""Predicted against measured: what the home page is given equals what the services say, under every filter."""

import csv
import datetime as dt
import io
import math
import random
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sqlalchemy as sa
from conftest import FormulaRunner, rows_of

from pdlab.comparison import Errors
from pdlab.experiments import (
    LISTED,
    Filters,
    Parity,
    Way,
    aggregates_in_mixtures,
    compare,
    comparisons,
    methods_used,
    parity,
    parity_csv,
    predict,
    register,
)
from pdlab.experiments import parity as service
from pdlab.experiments.comparing import CONSTANT, VOLUME_MEAN, Compared
from pdlab.models import Mixture, PackingTest, Prediction
from pdlab.store import Store
from pdlab.tables import csv_text, read_path

ROOM = __import__("sys").modules[service.__module__]
AGGREGATES = {"A": 0.58, "B": 0.6, "C": 0.57, "D": 0.585}
MIXTURES = {
    "A+B": ("A", "B", "loose", "2026-03-01"), "A+C": ("A", "C", "loose", "2026-03-20"),
    "B+C 100%": ("B", "C", "vibrated", "2026-04-02"), "b+d": ("B", "D", "unstated", ""), "C+D": ("C", "D", "", ""),
    "A+D": ("A", "D", "loose", "2026-04-20"),
}  # fmt: skip


@pytest.fixture
def lab(store: Store, folder: Callable[..., Path], formula_runner: Any) -> Store:
    """Six mixtures of four aggregates: tests of every kind, one not tested, one not predicted, one outdated."""
    sieves = [f"{name},{16 >> k},{share}" for k, name in enumerate(AGGREGATES) for share in ("0",)]
    sieves += [f"{name},{8 >> k},100" for k, name in enumerate(AGGREGATES)]
    ways = {"A": "unstated"}  # which is simulated as loose
    tests = [f"{name},{ways.get(name, 'loose')},,,{value},,," for name, value in AGGREGATES.items()]
    tests += [
        "A+B,loose,,36.5,,4,0.6,2026-03-01", "A+C,loose,1700,,,2,20,2026-03-20",
        "B+C 100%,vibrated,,,0.63,,,2026-04-02",
        "b+d,unstated,,,0.625,3,0.004,", "A+D,loose,,,0.61,,,2026-04-20",
    ]  # fmt: skip
    register(store, read_path(folder(
        aggregates="name,particle_density_kg_m3,density_basis\n" + "".join(f"{a},2650,oven_dry\n" for a in AGGREGATES),
        sieves="aggregate,aperture_mm,retained_percent\n" + "\n".join(sieves) + "\n",
        packing_tests="material,compaction,bulk_density_kg_m3,voids_percent,packing_density,repeats,"
        "standard_deviation,date\n" + "\n".join(tests) + "\n",
        mixtures="mixture,aggregate,solid_volume_share\n"
        + "".join(f"{name},{part},0.5\n" for name, parts in MIXTURES.items() for part in parts[:2]),
    )))  # fmt: skip
    names = [name for name in MIXTURES if name != "A+D"]
    predict(store, formula_runner(store), names)
    predict(store, formula_runner(store), ["A+B", "B+C 100%", "A+C"], Way("graded"))
    later = folder(packing_tests="material,compaction,packing_density\nD,loose,0.59\n") / "packing_tests.csv"
    register(store, read_path(later))
    return store


def names(found: Parity) -> list[str]:
    """The mixtures of what is listed, each once."""
    return sorted({str(row[LISTED.index("mixture")]) for row in found.listed})


def test_the_list_says_what_the_services_say(lab: Store) -> None:
    columns = ("packing_density", "expected_error", "measured", "measured_error", "difference")
    rows = {row[2:4]: dict(zip(LISTED, row, strict=True)) for row in parity(lab).listed}
    reports = comparisons(lab)
    assert {"done", "open", "outdated"} == {report.state for report in reports}
    for report in reports:
        row = rows.pop((report.mixture, None if report.state == "open" else report.method))
        assert [row[name] for name in columns] == pytest.approx([getattr(report, name) for name in columns])
        assert (row["state"], row["message"]) == (report.state, report.message)
    assert not rows


def test_the_figures_are_those_of_compare(lab: Store) -> None:
    known = {one.method: one for one in compare(lab).over_own}
    reports = [report for report in comparisons(lab) if report.state == "done" and report.measured is not None]
    judged = parity(lab).judged
    assert [one.method for one in judged] == ["graded", "monosized"]
    for one in judged:
        assert one.errors == known[one.method].errors
        over = [report for report in reports if report.mixture in known[one.method].mixtures]
        off = [abs((report.volume_mean or 0.0) - (report.measured or 0.0)) for report in over
               if report.method == one.method]  # fmt: skip
        assert one.volume_mean == pytest.approx(sum(off) / len(off))
        assert (one.compared, one.otherwise) == (2, 1)  # 'B+C' is vibrated, its aggregates were tested loose


SAID = ("expected_error", "message")
WAYS = ("loose", "rodded", "vibrated", "unstated", "")


def drawn(target: Store, folder: Callable[..., Path], seed: int) -> Store:
    """A store of aggregates and mixtures whose tests are of any compaction or missing; some tested anew, predicted."""
    draw = random.Random(seed)

    def tests(names: Iterable[str], ways: Iterable[str]) -> str:
        lines = ["material,compaction,bulk_density_kg_m3,voids_percent,packing_density"]
        for name, way in zip(names, ways, strict=True):
            density = draw.uniform(0.575, 0.605)
            value = draw.choice((*[f"{2450.0 * density},,"] * 3, f",{100.0 - 100.0 * density},", f",,{density}"))
            lines += [f"{name},{way},{value}"] if way else []
        return "\n".join(lines)

    parts, usual = [f"A{k}" for k in range(8)], draw.choice(WAYS[:3])
    ways = [draw.choice((*[usual] * 6, *WAYS)) for _ in parts]
    blends = {f"M{k:02}": draw.sample(parts, draw.choice((2, 2, 3))) for k in range(24)}
    of_blends = [draw.choice((ways[parts.index(few[0])], *WAYS)) for few in blends.values()]
    bases = ("2500,oven_dry,", "2540,ssd,1.2", "2600,apparent,1.1")
    register(target, read_path(folder(
        aggregates="name,particle_density_kg_m3,density_basis,water_absorption_percent,repose_angle_deg\n"
        + "".join(f"{name},{bases[k % 3]},{draw.uniform(15.0, 20.0)}\n" for k, name in enumerate(parts)),
        sieves="aggregate,aperture_mm,passing_percent\n"
        + "".join(f"{name},{20 * k + 20},100\n{name},{20 * k},0\n" for k, name in enumerate(parts, 1)),
        packing_tests=tests((*parts, *blends), (*ways, *of_blends)),
        mixtures="mixture,aggregate,solid_volume_share\n"
        + "".join(f"{name},{part},{1.0 / len(few)}\n" for name, few in blends.items() for part in few),
    )))  # fmt: skip
    methods = ("monosized", "repose", "ordered", "drop_and_roll")
    for method in methods:
        predict(target, FormulaRunner(target), (), Way(method))
    anew = [*draw.sample(parts, 3), *draw.sample(list(blends), 6)]
    ways_anew = [draw.choice(WAYS[:4]) for _ in anew]
    register(target, read_path(folder(packing_tests=tests(anew, ways_anew)) / "packing_tests.csv"))
    predict(target, FormulaRunner(target), draw.sample(list(blends), 10))
    return target


@pytest.mark.parametrize("seed", range(3))
def test_whatever_was_tested_how_the_figures_are_those_of_compare(
    store: Store, folder: Callable[..., Path], seed: int
) -> None:
    drawn(store, folder, seed)
    names = [f"M{k:02}" for k in range(24)]
    for search in ("", "1"):
        asked = [name for name in names if search in name]
        known, reports = compare(store, asked), comparisons(store, names=asked)
        own = {one.method: one for one in known.over_own}
        found = parity(store, Filters(search=search)).judged
        assert {one.method for one in found} == {report.method for report in reports if report.state != "open"}
        for one in found:
            done = [report for report in reports if report.method == one.method and report.state == "done"]
            over = own[one.method].mixtures if one.method in own else ()
            measured = sum(report.measured is not None for report in done)
            assert (one.compared, one.otherwise) == (len(over), measured - len(over))
            assert numbers_of(one.errors) == pytest.approx(numbers_of(own[one.method].errors if over else None))
            assert one.volume_mean == mean_off(known, VOLUME_MEAN, over)
            assert one.best_constant == (mean_off(compare(store, over), CONSTANT, over) if over else None)
    said = {row[:2]: row[2:] for row in rows_of(store, "predictions", ["state!=open"], ["mixture", "method", *SAID])}
    for report in comparisons(store):
        error, message = said[report.mixture, report.method]
        assert (error, message) == (pytest.approx(report.expected_error), report.message)
    known = compare(store)
    for name in names:
        found = parity(store, Filters(search=name)).judged
        alone = {one.method: mean_off(known, VOLUME_MEAN, [name]) for one in known.over_own if name in one.mixtures}
        assert [one.volume_mean for one in found if one.compared] == [
            alone[one.method] for one in found if one.compared
        ]


def numbers_of(errors: Errors | None) -> list[float | None]:
    """All numbers of a method's errors."""
    if errors is None:
        return []
    figures = (errors.bias, errors.mean_absolute, errors.root_mean_square)
    ends = [value for one in figures for value in (one.value, one.low, one.high)]
    return [errors.mixtures, errors.largest, errors.where, *ends]


def mean_off(known: Compared, method: str, mixtures: Sequence[str]) -> Any:
    """The mean absolute error of a method over mixtures, None where it has none of one of them."""
    off = [known.difference(method, name) for name in mixtures]
    return pytest.approx(np.abs(off).mean()) if off and None not in off else None


def test_the_mean_of_the_others_is_judged_over_the_same_mixtures(lab: Store) -> None:
    found = parity(lab, Filters(search="A+"))
    measured = sorted(found.points.measured[[method == "graded" for method in found.points.method]].tolist())
    assert len(measured) == 2
    graded = next(one for one in found.judged if one.method == "graded")
    assert graded.best_constant == pytest.approx(measured[1] - measured[0])


def test_outdated_and_failed_predictions_are_counted_and_left_out_of_the_figures(lab: Store) -> None:
    found = parity(lab)
    assert found.states == {"done": 6, "outdated": 2, "failed": 0}
    current = dict(zip(found.points.mixture, found.points.current.tolist(), strict=True))
    assert current == {"A+B": True, "A+C": True, "B+C 100%": True, "b+d": False}  # 'C+D' was not tested
    with lab.write() as session:
        session.execute(sa.update(Prediction).where(Prediction.method == "graded").values(
            state="failed", packing_density=None, message="out of reach"))  # fmt: skip
    found = parity(lab)
    assert found.states == {"done": 3, "outdated": 2, "failed": 3}
    assert {one.method: one.compared for one in found.judged} == {"monosized": 2, "graded": 0}
    assert [row[LISTED.index("message")] for row in parity(lab, Filters(states=("failed",))).listed] == [
        "out of reach"
    ] * 3


def test_what_is_missing_is_told(lab: Store) -> None:
    found = parity(lab)
    assert (found.mixtures, found.measured) == (6, 5)
    assert (found.opened, list(found.open.values()), found.unmeasured) == (1, ["A+D"], 0)
    with lab.write() as session:
        session.add(Mixture(name="nobody's"))
    assert parity(lab).unmeasured == 1


def every(lab: Store, test: Callable[[str, tuple[str, str, str, str]], bool]) -> list[str]:
    return sorted(name for name, facts in MIXTURES.items() if test(name, facts))


def test_a_filter_leaves_what_meets_it_and_several_what_meets_all(lab: Store) -> None:
    single: Iterable[tuple[Filters, Callable[[str, tuple[str, str, str, str]], bool]]] = (
        (Filters(), lambda name, facts: True),
        (Filters(search=" B+ "), lambda name, facts: "b+" in name.lower()),
        (Filters(search="0%"), lambda name, facts: "0%" in name),
        (Filters(aggregates=("A",)), lambda name, facts: "A" in facts[:2]),
        (Filters(aggregates=("A", "D")), lambda name, facts: "A" in facts[:2] or "D" in facts[:2]),
        (Filters(aggregates=("Z",)), lambda name, facts: False),
        (Filters(compactions=("loose", "unstated")), lambda name, facts: facts[2] in ("loose", "unstated")),
        (Filters(since=dt.date(2026, 3, 20), until=dt.date(2026, 4, 2)), lambda name, facts: facts[3] in
         ("2026-03-20", "2026-04-02")),
        (Filters(aggregates=("A",), since=dt.date(2026, 3, 20), search="c"), lambda name, facts: name == "A+C"),
    )  # fmt: skip
    for asked, test in single:
        assert names(parity(lab, asked)) == every(lab, test), asked
        assert parity(lab, asked).mixtures == len(every(lab, test)), asked


def test_a_test_without_a_day_counts_from_when_it_was_entered(lab: Store) -> None:
    with lab.read() as session:
        entered = session.scalars(
            sa.select(PackingTest.created_at).where(PackingTest.mixture_id.is_not(None), PackingTest.date.is_(None))
        ).one()
    assert names(parity(lab, Filters(since=entered.date(), until=entered.date()))) == ["b+d"]
    assert rows_of(lab, "predictions", [f"tested={entered.date()}"], ["mixture"]) == [("b+d",)]


def test_methods_and_states_choose_predictions_and_leave_the_figures(lab: Store) -> None:
    asked = Filters(methods=("graded",), states=("done", "outdated"))
    found, whole = parity(lab, asked), parity(lab)
    assert set(found.points.method) == {row[LISTED.index("method")] for row in found.listed} == {"graded"}
    assert found.judged == whole.judged
    assert (found.opened, found.mixtures) == (whole.opened, whole.mixtures)
    assert names(parity(lab, Filters(states=("outdated",)))) == ["C+D", "b+d"]


def test_the_newest_are_listed_first_and_what_was_picked_alone(lab: Store) -> None:
    ids = [row[0] for row in parity(lab).listed]
    predicted = [key for key in ids if key is not None]
    assert predicted == sorted(predicted, reverse=True)
    assert [row[0] for row in parity(lab, most=3).listed] == ids[:3]
    found = parity(lab, ids=predicted[1:3])
    assert ([row[0] for row in found.listed], found.chosen) == (predicted[1:3], 2)
    assert len(found.points.ids) == parity(lab).shown


def test_more_points_than_can_be_told_apart_are_counted_by_cells(lab: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    shown = parity(lab).shown
    monkeypatch.setattr(ROOM, "MOST_POINTS", shown)
    points = parity(lab).points
    assert (parity(lab).density, len(points.ids)) == (None, shown)
    monkeypatch.setattr(ROOM, "MOST_POINTS", shown - 1)
    found = parity(lab)
    assert found.density is not None
    assert len(found.points.ids) == 0
    assert (found.density.current.sum(), found.density.outdated.sum()) == (shown - 1, 1)
    cells = list(zip(found.density.column.tolist(), found.density.row.tolist(), strict=True))
    own = np.floor(np.stack([points.measured, points.predicted]) / found.density.width).astype(int)
    assert set(cells) == set(zip(*own.tolist(), strict=True))
    picked = parity(lab, cells=[(*cells[0], 1)])
    wanted = {key for key, cell in zip(points.ids.tolist(), zip(*own.tolist(), strict=True), strict=True)
              if cell == cells[0]}  # fmt: skip
    assert set(picked.points.ids.tolist()) == {row[0] for row in picked.listed} == wanted
    assert not np.isnan(picked.points.expected_error).any()


def test_cells_grow_until_there_are_not_too_many_and_hold_the_same(lab: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ROOM, "MOST_POINTS", 1)
    finest = parity(lab).density
    assert finest is not None
    monkeypatch.setattr(ROOM, "MOST_CELLS", finest.column.size - 1)
    found = parity(lab).density
    assert found is not None
    assert found.times in ROOM.WIDER[1:]
    assert found.column.size < finest.column.size
    assert (found.current + found.outdated).sum() == (finest.current + finest.outdated).sum()
    monkeypatch.setattr(ROOM, "MOST_CELLS", 0)
    widest = parity(lab).density
    assert widest is not None
    assert widest.times == ROOM.WIDER[-1]
    cell = (int(widest.column[0]), int(widest.row[0]), widest.times)
    assert parity(lab, cells=[cell]).chosen == widest.current[0] + widest.outdated[0]


def test_two_thousand_are_points_and_one_more_are_not() -> None:
    assert ROOM.MOST_POINTS == 2000


def test_the_file_holds_every_row_under_the_filters_with_all_digits(lab: Store) -> None:
    asked = Filters(methods=("monosized",))
    rows = list(csv.DictReader(io.StringIO(parity_csv(lab, asked))))
    listed = [dict(zip(LISTED, row, strict=True)) for row in parity(lab, asked).listed]
    assert len(rows) == len(listed) == 5
    for row, known in zip(rows, listed, strict=True):
        assert float(row["packing_density"]) == known["packing_density"]
        assert row["measured"] == ("" if known["measured"] is None else repr(known["measured"]))
        assert (row["mixture"], row["compaction"]) == (known["mixture"], known["compaction"] or "")
        assert row["tested"] == ("" if known["tested"] is None else known["tested"].isoformat())


def test_no_text_of_a_file_to_look_at_is_a_formula() -> None:
    text = csv_text(("a", "b"), [("=1+1", -0.5), (" @x", None), ("A+B", 1e-7), ('say "x"', 2)])
    assert list(csv.reader(io.StringIO(text))) == [
        ["a", "b"], ["'=1+1", "-0.5"], ["' @x", ""], ["A+B", "1e-07"], ['say "x"', "2"],
    ]  # fmt: skip


def test_filters_are_offered_for_what_the_store_holds(lab: Store) -> None:
    assert aggregates_in_mixtures(lab, 10) == ["A", "B", "C", "D"]
    assert aggregates_in_mixtures(lab, 2) == ["A", "B"]
    assert methods_used(lab) == ["graded", "monosized"]


def test_an_empty_store_has_nothing_to_show(store: Store) -> None:
    found = parity(store)
    assert (found.mixtures, found.shown, found.judged, found.listed, found.density) == (0, 0, (), (), None)
    assert parity_csv(store).count("\n") == 1


def test_a_method_that_rests_on_no_density_test_is_judged_beside_the_volume_mean_of_what_was_tested(
    pebbles: Store,
) -> None:
    predict(pebbles, FormulaRunner(pebbles), way=Way("ordered"))
    found = parity(pebbles)
    off = pytest.approx(mean_off(compare(pebbles), VOLUME_MEAN, compare(pebbles).common))
    assert [(one.method, one.compared, one.volume_mean) for one in found.judged] == [("ordered", 3, off)]
    assert all(math.isfinite(value) for value in found.points.measured_error)
