"""An aggregate, or a mixture's density test, as a form holds it: its texts, what they say while they are typed."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import pandas as pd

from pdlab import density, store, tables
from pdlab.density import MeasuredPacking
from pdlab.errors import DensityError, InputError, PdlabError, Problem, TableError, UnknownName
from pdlab.experiments.registration import Registered, register
from pdlab.grading import Grading, make_grading
from pdlab.store import Store
from pdlab.tables import PastedRow, Tables, above_zero

UNNAMED = "unnamed"
"""Stands for an aggregate whose name is not typed yet, so that the rest can be checked."""
AGGREGATE_TEXTS = (
    "name", "delivery", "particle_density_kg_m3", "density_basis", "water_absorption_percent", "shape", "source",
    "repose_angle_deg", "wall_angle_deg",
)  # fmt: skip
SIEVE_TEXTS = ("kind", "sample_mass_g", "pan_lower_mm", "sieve_standard", "sieve_date")
TEST_TEXTS = (
    "kind", "value", "compaction", "repeats", "standard_deviation", "container_diameter_mm", "container_height_mm",
    "moisture_percent", "standard", "date",
)  # fmt: skip
CHOSEN = {"kind", "compaction", "density_basis"}
"""Texts that are chosen and never empty: alone they say nothing."""


@dataclass(frozen=True)
class EnteredAggregate:
    """The texts of a form: ``texts`` by ``AGGREGATE_TEXTS`` and ``SIEVE_TEXTS``, sieve rows, and density tests.

    ``sieves``: an aperture and a value of ``texts["kind"]`` in each row. ``tests``: by ``TEST_TEXTS``.
    """

    texts: Mapping[str, str]
    sieves: Sequence[tuple[str, str]] = ()
    tests: Sequence[Mapping[str, str]] = ()

    def content(self) -> dict[str, Any]:
        """Return the texts as a draft keeps them."""
        return {
            "texts": dict(self.texts),
            "sieves": [list(row) for row in self.sieves],
            "tests": [*map(dict, self.tests)],
        }

    @property
    def is_blank(self) -> bool:
        """Whether nothing was entered yet; a choice alone, or the sieves of a set, is nothing."""
        return not (
            _filled(self.texts) or any(value.strip() for _, value in self.sieves) or any(map(_filled, self.tests))
        )

    @property
    def has_sieves(self) -> bool:
        """Whether a sieve has a value."""
        return any(value.strip() for _, value in self.sieves)

    def frames(self) -> dict[str, pd.DataFrame]:
        """Return the tables that an import would bring."""
        texts = self.texts
        name, delivery = texts["name"].strip() or UNNAMED, texts["delivery"].strip()
        own = {column: texts[column] for column in AGGREGATE_TEXTS} | {"name": name, "delivery": delivery}
        if not texts["particle_density_kg_m3"].strip():
            own["density_basis"] = ""
        out = {"aggregates": pd.DataFrame([own])}
        of_analysis = {
            "aggregate": name, "delivery": delivery, "pan_lower_mm": texts["pan_lower_mm"],
            "sample_mass_g": texts["sample_mass_g"] if texts["kind"] == "retained_g" else "",
            "standard": texts["sieve_standard"], "date": texts["sieve_date"],
        }  # fmt: skip
        rows = [{"aperture_mm": sieve, texts["kind"]: value} for sieve, value in self.sieves if value.strip()]
        if rows:
            out["sieves"] = pd.DataFrame([row | of_analysis for row in rows])
        tests = [_test_row(test, f"aggregate:{name}", delivery) for test in self.tests if _filled(test)]
        if tests:
            out["packing_tests"] = pd.DataFrame(tests).fillna("")
        return out


@dataclass(frozen=True)
class SievesRead:
    """What a sieve table says while it is typed: its rows with their errors, its own errors, or the grading."""

    rows: Sequence[PastedRow]
    wrong: Sequence[str] = ()
    grading: Grading | None = None


@dataclass(frozen=True)
class TestRead:
    """What a density test says while it is typed: the measured packing density, or what is wrong."""

    __test__ = False  # pytest: no test
    measured: MeasuredPacking | None = None
    wrong: Sequence[str] = ()


@dataclass(frozen=True)
class AggregateRead:
    """What a form says: ``wrong`` with the aggregate's own texts, its sieve table, each of its density tests."""

    wrong: Sequence[str]
    sieves: SievesRead
    tests: Sequence[TestRead]

    @property
    def is_sound(self) -> bool:
        """Whether nothing is marked as wrong."""
        rows = any(row.error for row in self.sieves.rows)
        return not (self.wrong or self.sieves.wrong or rows or any(test.wrong for test in self.tests))


def entered_of(content: Mapping[str, Any]) -> EnteredAggregate:
    """Return the texts that a draft keeps; what an older form did not ask for is empty."""
    texts = {name: content.get("texts", {}).get(name, "") for name in (*AGGREGATE_TEXTS, *SIEVE_TEXTS)}
    tests = [{name: test.get(name, "") for name in TEST_TEXTS} for test in content.get("tests", [])]
    return EnteredAggregate(texts, tuple((sieve, value) for sieve, value in content.get("sieves", [])), tests)


def entered_again(target: Store, aggregate_id: int) -> EnteredAggregate:
    """Return the form of a further sieve analysis or density test of an aggregate: it is filled in, its tests are not.

    Raises UnknownName.
    """
    with target.read() as session:
        row = next(iter(store.aggregates_by_id(session, [aggregate_id])), None)
    if row is None:
        raise UnknownName(f"the store holds no aggregate {aggregate_id}; choose another")
    values = {name: getattr(row, name) for name in AGGREGATE_TEXTS}
    texts = {name: f"{value:.15g}" if isinstance(value, float) else value or "" for name, value in values.items()}
    return EnteredAggregate(dict.fromkeys(SIEVE_TEXTS, "") | texts)


def read_entered(entered: EnteredAggregate) -> AggregateRead:
    """Return what a form's texts say, with all that is wrong in them."""
    found = tables.read_frames(entered.frames())
    of_tests = [k for k, test in enumerate(entered.tests) if _filled(test)]
    tests = [TestRead() for _ in entered.tests]
    for row, k in enumerate(of_tests, start=2):
        tests[k] = _read_test(found, row, entered.tests[k], partial(_dry_density, found))
    wrong = _problems(found, "aggregates", 2)
    return AggregateRead([*wrong, *_density_of(found)], _read_sieves(entered, found), tests)


def register_entered(target: Store, entered: EnteredAggregate) -> Registered:
    """Write what was entered, everything or nothing; return what is new and what equals what was there.

    Raises InputError, also where what is entered is not sound, or an aggregate would have no sieve analysis.
    """
    name, delivery = entered.texts["name"].strip(), entered.texts["delivery"].strip()
    if not name:
        raise InputError("the aggregate has no name; enter one")
    if not entered.has_sieves:
        with target.read() as session:
            if store.find_aggregate(session, name, delivery) is None:
                raise InputError("the sieve table is empty; enter at least one sieve with its aperture in mm")
    if not read_entered(entered).is_sound:
        raise InputError("not saved: mend what is marked above first")
    return register(target, tables.read_frames(entered.frames()))


def read_test(test: Mapping[str, str], particle: float | None) -> TestRead:
    """Return what a density test says; nothing of an empty one.

    ``test``: by ``TEST_TEXTS``; ``particle``: oven-dry particle density [kg/m³], of a mixture the mean by solid volume.
    """
    if not _filled(test):
        return TestRead()
    found = tables.read_frames({"packing_tests": pd.DataFrame([_test_row(test, f"mixture:{UNNAMED}")])})
    return _read_test(found, 2, test, lambda: particle)


def register_test(target: Store, mixture: str, test: Mapping[str, str]) -> bool:
    """Write a density test of a mixture as packing_tests.csv would; return whether it is new.

    It is not where it equals one that is there, which changes nothing. Raises InputError, TableError with every
    problem.
    """
    if not test["value"].strip():
        raise InputError("the density test has no value; enter one")
    frame = pd.DataFrame([_test_row(test, f"mixture:{mixture}")])
    return register(target, tables.read_frames({"packing_tests": frame})).new["density tests"] > 0


def sentences(error: PdlabError) -> list[str]:
    """Return what an error says, a sentence for each problem of a table, without its place and each once."""
    return list(dict.fromkeys(map(_sentence, error.problems))) if isinstance(error, TableError) else [str(error)]


def _filled(texts: Mapping[str, str]) -> bool:
    return any(text.strip() for name, text in texts.items() if name not in CHOSEN)


def _test_row(test: Mapping[str, str], material: str, delivery: str = "") -> dict[str, str]:
    others = {column: text for column, text in test.items() if column not in ("kind", "value")}
    return others | {"material": material, "delivery": delivery, test["kind"]: test["value"]}


def _problems(found: Tables, kind: str, row: int) -> list[str]:
    return [_sentence(one) for one in found.problems if one.file == f"{kind} frame" and one.row == row]


def _sentence(problem: Problem) -> str:
    return problem.message if problem.column is None else f"{problem.column}: {problem.message}"


def _read_sieves(entered: EnteredAggregate, found: Tables) -> SievesRead:
    of_date = [one for one in found.problems if one.file == "sieves frame" and one.column in ("date", "standard")]
    dated = dict.fromkeys(map(_sentence, of_date))
    kind, texts = entered.texts["kind"], entered.texts
    rows = tables.read_cells(entered.sieves, kind)
    if not entered.has_sieves:
        return SievesRead(rows)
    try:
        mass = _above_zero(texts["sample_mass_g"], "sample mass", "g") if kind == "retained_g" else None
        pan = _above_zero(texts["pan_lower_mm"], "smallest grain in the pan", "mm")
    except InputError as error:
        return SievesRead(rows, [str(error)])
    table, rows, wrong = tables.check_pasted(rows, kind, mass, pan)
    return SievesRead(rows, [*wrong, *dated], None if table is None else make_grading(table))


def _above_zero(text: str, what: str, unit: str) -> float | None:
    try:
        return above_zero(unit)(text) if text.strip() else None
    except InputError as error:
        raise InputError(f"{what}: {error}") from error


def _density_of(found: Tables) -> list[str]:
    try:
        _dry_density(found)
    except DensityError as error:
        return [str(error)]
    return []


def _dry_density(found: Tables) -> float | None:
    """Return the oven-dry particle density [kg/m³] that was entered, None where none was. Raises DensityError."""
    cells = found.aggregates[0].cells if found.aggregates else {}
    if cells.get("particle_density_kg_m3") is None:
        return None
    return density.oven_dry_density(
        cells["particle_density_kg_m3"], cells["density_basis"], cells["water_absorption_percent"]
    )


def _read_test(found: Tables, row: int, test: Mapping[str, str], particle: Callable[[], float | None]) -> TestRead:
    """Return what the density test in a row says; ``particle`` may raise DensityError."""
    wrong = _problems(found, "packing_tests", row)
    if not test["value"].strip():
        wrong = ["the density test has no value; enter it, or empty its other fields"]
    if wrong:
        return TestRead(wrong=wrong)
    cells, kind = next(one.cells for one in found.packing_tests if one.line == row), test["kind"]
    try:
        return TestRead(
            density.measured_packing(kind, cells[kind], particle(), cells["repeats"], cells["standard_deviation"])
        )
    except DensityError as error:
        return TestRead(wrong=[str(error)])
