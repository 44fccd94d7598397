"""The lab report: one file that asks nothing of another, texts escaped, every number there, nothing stale unseen."""

import base64
import datetime as dt
import re
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from html.parser import HTMLParser
from pathlib import Path

import pytest
import sqlalchemy as sa
from conftest import FormulaRunner, both
from hypothesis import given, settings
from hypothesis import strategies as st
from test_cli import pdlab, refused
from test_mixing import dense, ids
from test_repose import AGGREGATES, BY_ANGLE, MIXTURES, SIEVES

from pdlab import cli, experiments, report
from pdlab import store as store_module
from pdlab.density import COMPACTIONS
from pdlab.errors import InputError, ProtocolError, UnknownName
from pdlab.experiments import METHODS, OTHERS, REFERENCES, ShownRun, Way, shipped
from pdlab.grading import RULES
from pdlab.lab import SHIPPED, Lab
from pdlab.models import Calibration, Prediction, Run
from pdlab.report import figures, methods, pages
from pdlab.store import Store, open_store
from pdlab.tables import read_path

AT = dt.datetime(2026, 3, 31, 14, 5, 6, tzinfo=dt.timezone(dt.timedelta(hours=2)))
EQUAL = "pebbles L+F 1:1"
NASTY = (
    "</style><script>alert(1)</script>",
    " ".join(
        ("\"'><img src=x onerror=alert(1)>", "a & b &lt; c", "$x_1$ 100 % μ ≤ 5", "{{ 7 * 7 }} {% raw %}", "-->",
         "javascript:alert(1)", "\\22 ; content: url(http://a.b/)", "名 🪨 é", "<b>bold</b>", "]]>")
    ),
)  # fmt: skip


class Read(HTMLParser):
    """A report as a browser takes it: its elements with their attributes, its texts, its style sheet."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.elements, self.texts, self.style = list[tuple[str, dict[str, str | None]]](), list[str](), ""
        self.feed(html)
        self.close()
        self.text = " ".join(" ".join(self.texts).split())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        if self.elements and self.elements[-1][0] == "style" and not self.style:
            self.style = data
        else:
            self.texts.append(data)

    def shape(self) -> list[tuple[str, tuple[str, ...]]]:
        return [(tag, tuple(attributes)) for tag, attributes in self.elements]


def mixture_id(target: Store, name: str = EQUAL) -> int:
    return experiments.reported(target, f"mixture:{name}")[1]


def of_mixture(target: Store, method: str | None = None) -> Read:
    return Read(report.mixture(target, mixture_id(target), method, AT))


def of_aggregate(target: Store, name: str = "pebbles F") -> Read:
    return Read(report.aggregate(target, ids(target, name)[0], AT))


@pytest.fixture(scope="module")
def database() -> Iterator[sa.Connection]:
    """SQLite alone: what a report reads is read by services that are tested on both databases."""
    with connected() as connection:
        yield connection


@contextmanager
def connected() -> Iterator[sa.Connection]:
    made = open_store("sqlite://")
    assert isinstance(made.writer, sa.Engine)
    with made.writer.connect() as connection:
        yield connection
    made.close()


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory, empty_table: Path) -> Iterator[sa.Connection]:
    """A store of three predicted mixtures."""
    with connected() as connection, pytest.MonkeyPatch.context() as patch:
        patch.setattr(shipped, "TABLE", empty_table)
        made = Store("sqlite://", connection, connection)
        with connection.begin():
            experiments.register(made, read_path(SHIPPED))
            dense(made, tmp_path_factory.mktemp("dense"))
            experiments.predict(made, FormulaRunner(made))
        yield connection


@pytest.fixture
def predicted(filled: sa.Connection) -> Iterator[Store]:
    """The filled store; what a test writes is rolled back after it."""
    outer = filled.begin()
    yield Store("sqlite://", filled, filled)
    outer.rollback()


@pytest.fixture
def drawn() -> bool:
    """For a test whose figures are drawn."""
    return True


@pytest.fixture(autouse=True)
def _undrawn(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw no figures in the tests of words: they take most of the time that a report takes."""
    if "drawn" not in request.fixturenames:
        monkeypatch.setattr(figures, "_svg", lambda *_: '<svg xmlns="http://www.w3.org/2000/svg"><use href="#"/></svg>')


def check_alone(html: str) -> None:
    """Check that a file asks nothing of another and runs nothing."""
    read = Read(html)
    tags = {tag for tag, _ in read.elements}
    assert not tags & {"script", "link", "iframe", "object", "embed", "base", "form", "a", "audio", "video", "image"}
    for tag, attributes in read.elements:
        assert not [name for name in attributes if name.startswith("on") or name in ("href", "srcset", "style")]
        assert tag == "img" or "src" not in attributes
    assert "url(" not in read.style
    assert "@import" not in read.style
    (policy,) = [given["content"] for _, given in read.elements if given.get("http-equiv") == "Content-Security-Policy"]
    assert "default-src 'none'" in str(policy)
    assert "script-src" not in str(policy)
    for _, attributes in (one for one in read.elements if one[0] == "img"):
        kind, _, data = str(attributes["src"]).partition(",")
        assert kind == "data:image/svg+xml;base64"
        svg = base64.b64decode(data).decode()
        asked = re.findall(r'(?:href|src)="([^"]*)"', svg) + re.findall(r"url\(([^)]*)\)", svg)
        assert asked
        assert all(place.startswith("#") for place in asked)
        assert "<script" not in svg


@pytest.mark.parametrize("method", ["monosized_rolling", "graded", "drop_and_roll", "ordered"])
def test_a_report_asks_nothing_of_another_file_or_host_by_any_method(pebbles: Store, method: str, drawn: bool) -> None:
    experiments.predict(pebbles, FormulaRunner(pebbles), [EQUAL], Way(method))
    check_alone(report.mixture(pebbles, mixture_id(pebbles), at=AT))
    check_alone(report.aggregate(pebbles, ids(pebbles, "pebbles L")[0], at=AT))
    read = of_mixture(pebbles)
    assert methods.METHODS[method] in read.text
    assert (read.text.count(report.REFERENCE) == 2) == (method in REFERENCES)


def poison(target: Store, mixture: int, aggregate: int, text: str) -> None:
    """Put a text into every field of the store that holds words which a report shows."""
    with target.write() as session:
        (row,) = store_module.aggregates_by_id(session, [aggregate])
        (blend,) = store_module.mixtures_by_id(session, [mixture])
        row.name = row.delivery = row.source = row.shape = blend.name = text
        for test in (*row.packing_tests, *blend.packing_tests):
            test.standard = test.raw_text = text
        row.sieve_analyses[-1].standard = text
        for result in row.sieve_analyses[-1].results:
            result.raw_text = text
        for table in (Calibration, Prediction):
            for fit in session.query(table).all():
                fit.warnings = text
        for run in session.query(Run).all():
            run.numba_version = run.processor = text
        for one in store_module.corrections(session):
            one.corrected_by = one.reason = one.old_value = one.new_value = text


@pytest.mark.parametrize("asked", NASTY)
def test_no_text_of_a_user_becomes_an_element_and_each_stands_as_it_is(predicted: Store, asked: str) -> None:
    text = asked
    key, aggregate = mixture_id(predicted), ids(predicted, "pebbles F")[0]
    experiments.correct(predicted, {"packing_test:3": {"voids_percent": "41.6"}}, "plain", "plain")

    def reports() -> list[Read]:
        poison(predicted, key, aggregate, text)
        made = [report.mixture(predicted, key, at=AT), report.aggregate(predicted, aggregate, at=AT)]
        for html in made:
            check_alone(html)
        return [Read(re.sub(r"version \d+ of its record", "", html)) for html in made]

    nasty, text = reports(), "plain"
    for read, plain in zip(nasty, reports(), strict=True):
        assert read.shape() == plain.shape()
        assert plain.text.count("plain") >= 15
        assert read.text == plain.text.replace("plain", asked)
        told = [line for line in read.style.splitlines() if line not in plain.style]
        assert told, "the head of the printed page names it"
        assert all("pdlab report:" in line for line in told)


@settings(max_examples=40)
@given(st.text(max_size=pages.LONGEST + 5))
def test_a_text_in_a_style_sheet_says_itself_and_ends_nothing(text: str) -> None:
    made = pages.css_text(text)
    assert re.fullmatch(r"([0-9A-Za-z ]|\\[0-9a-f]{1,6} )*", made)
    back = re.sub(r"\\([0-9a-f]{1,6}) ", lambda found: chr(int(found[1], 16)), made)
    assert back == (text if len(text) <= pages.LONGEST else text[: pages.LONGEST - 1] + "…")


@settings(max_examples=40)
@given(st.text(max_size=20))
def test_a_name_becomes_the_name_of_a_file(name: str) -> None:
    assert re.fullmatch(r"report-[0-9A-Za-z_.+-]+\.html", report.file_name(name))
    assert len(report.file_name(300 * name)) < 100


def test_every_number_of_a_mixture_stands_in_its_report(predicted: Store) -> None:
    document = experiments.mixture_document(predicted, mixture_id(predicted))
    read = of_mixture(predicted)
    assert [one.name for one in document.amounts] == [
        "packing_density", "voids_percent", "bulk_density_kg_m3", "void_volume",
    ]  # fmt: skip
    for one, digits in zip(document.amounts, (4, 2, 1, 1), strict=True):
        values = (one.predicted, one.standard_error, one.input_error, one.expected_error, one.measured,
                  one.measured_error)  # fmt: skip
        assert " ".join(f"{value:.{digits}f}" for value in values) in read.text
    assert document.amounts[2].predicted == pytest.approx(2500.0 * (document.prediction.packing_density or 0.0))
    for name in ("volume_mean", "furnas", "toufar", "cpm"):
        value = getattr(document.prediction, name)
        assert f"{value:.4f} {value - document.prediction.measured:+.4f}" in read.text
    assert len(document.calibrations) == 2
    for fit in document.calibrations:
        value, low, high = fit.friction
        assert f"{value:.4g}, {low:.4g} to {high:.4g}" in read.text
        assert f"{fit.packing_density:.4f} ± {fit.curve_error:.4f} (curve) ± {fit.input_error:.4f}" in read.text
        check_runs(fit.runs, read)
    check_runs(document.runs, read)
    assert f"{len(document.all_runs)} by engine version" in read.text
    assert "31 14:05:06 (UTC+02:00)" in read.text


def check_runs(runs: tuple[ShownRun, ...], read: Read) -> None:
    assert len(runs) >= 4
    for run in runs:
        assert f"{run.seed}: {run.packing_density:.5f} {run.digest[:12]}" in read.text


def test_every_number_of_an_aggregate_stands_in_its_report(predicted: Store, tmp_path: Path) -> None:
    (tmp_path / "packing_tests.csv").write_text(
        "material,compaction,voids_percent,repeats,standard_deviation,container_diameter_mm,container_height_mm,"
        "moisture_percent,standard,date\npebbles F,rodded,40.25,3,0.75,152.5,155.5,1.25,EN 1097-3,2026-03-30\n"
    )
    experiments.register(predicted, read_path(tmp_path / "packing_tests.csv"))
    experiments.calibrate(predicted, FormulaRunner(predicted), ["pebbles F"])
    document = experiments.aggregate_document(predicted, ids(predicted, "pebbles F")[0])
    read = of_aggregate(predicted)
    assert document.calibration is not None
    check_runs(document.calibration.runs, read)
    for said in ("rodded", "40.25", "0.75", "152.5 mm wide, 155.5 mm high", "1.25 %", "EN 1097-3", "2026-03-30",
                 "0.5975", f"{0.0075 / 3**0.5:.4f}", "2000 kg/m³, basis oven_dry", "20.32 100"):  # fmt: skip
        assert said in read.text, said
    for name, value in document.indices.items():
        assert f"{value:.4g}" in read.text, name
    assert [line.retained for test in document.inputs.sieves for line in test.lines] == pytest.approx([0.0, 100.0])
    assert methods.METHODS["monosized"] in read.text
    assert methods.RULES["log_mean"] in read.text
    assert "drops 25" in read.text


def test_the_same_store_and_date_give_the_same_bytes_in_several_threads_too(predicted: Store, drawn: bool) -> None:
    document = experiments.mixture_document(predicted, mixture_id(predicted))
    first = report.mixture(predicted, document.key, at=AT)
    assert report.mixture(predicted, document.key, at=AT) == first
    other = report.mixture(predicted, document.key, at=AT + dt.timedelta(seconds=1))
    assert other.replace(pages.moment(AT + dt.timedelta(seconds=1)), pages.moment(AT)) != other
    explained = document.parts[0].explained
    assert explained.curve is not None
    with ThreadPoolExecutor(4) as pool:
        drawn = set(pool.map(lambda _: figures.calibration_curve(explained, explained.curve), range(8)))  # type: ignore[arg-type]
    assert len(drawn) == 1


def test_what_is_calibrated_to_an_angle_shows_its_heaps_and_beds(store: Store, tmp_path: Path) -> None:
    for name, text in (("aggregates", AGGREGATES), ("sieves", SIEVES), ("mixtures", MIXTURES)):
        (tmp_path / f"{name}.csv").write_text(text, encoding="utf-8")
    experiments.register(store, read_path(tmp_path))
    experiments.predict(store, FormulaRunner(store), ["M"], BY_ANGLE)
    document = experiments.aggregate_document(store, ids(store, "stone")[0])
    read = of_aggregate(store, "stone")
    assert marks(read) == (0, False)
    assert document.calibration is not None
    heaps = [run for run in document.calibration.runs if run.repose_angle_deg is not None]
    assert 0 < len(heaps) < len(document.calibration.runs)
    for run in heaps:
        assert f"{run.seed}: {run.repose_angle_deg:.2f} {run.digest[:12]}" in read.text
    for said in ("angle of repose 20°", "slip angle 25°", "PD or angle of repose", methods.METHODS["repose"],
                 "a standard error of 1 degree is assumed"):  # fmt: skip
        assert said in read.text, said
    mixed = Read(report.mixture(store, mixture_id(store, "M"), at=AT))
    assert marks(mixed) == (0, False)
    assert "Its runs are those of calibration" not in mixed.text


def marks(read: Read) -> tuple[int, bool]:
    """How often a mark stands in the text, and whether it stands on every page."""
    words = [mark for mark in report.STATES.values() if mark in read.text]
    assert len(words) <= 1
    on_pages = any(pages.css_text(mark) in read.style for mark in report.STATES.values())
    return (read.text.count(words[0]) if words else 0), on_pages


def test_a_result_that_is_current_has_no_mark_and_one_that_is_not_has_it_on_every_page(
    predicted: Store, tmp_path: Path
) -> None:
    for read in (of_mixture(predicted), of_aggregate(predicted)):
        assert marks(read) == (0, False)
        assert "(expected), predicted by" in read.text or "(curve)" in read.text
    (tmp_path / "packing_tests.csv").write_text("material,compaction,packing_density\npebbles F,loose,0.59\n")
    experiments.register(predicted, read_path(tmp_path / "packing_tests.csv"))
    for read in (of_mixture(predicted), of_aggregate(predicted)):
        assert marks(read) == (2, True), "at the result and at the signatures"
        assert report.STATES["outdated"] in read.text
        assert "tested or sieved anew since, or corrected" in read.text
        assert "(expected), predicted by" not in read.text


def test_a_mixture_tested_in_another_compaction_than_its_beds_says_so_beside_the_difference_and_the_signatures(
    predicted: Store, tmp_path: Path
) -> None:
    def said(method: str = "monosized") -> int:
        text = of_mixture(predicted, method).text.lower()
        return text.count("the mixture's density test is rodded, its beds are loose: the difference is of both")

    assert said() == 0
    (tmp_path / "packing_tests.csv").write_text(f"material,compaction,packing_density\n{EQUAL},rodded,0.68\n")
    experiments.register(predicted, read_path(tmp_path / "packing_tests.csv"))
    assert said() == 2
    experiments.predict(predicted, FormulaRunner(predicted), [EQUAL], Way("ordered"))
    assert said("ordered") == 0, "which knows no compaction"


@pytest.mark.parametrize("text", ["{broken", "{}", "[1]", '{"species": [{"count": "many"}]}'])
def test_a_run_whose_specimen_cannot_be_read_is_a_sentence(predicted: Store, text: str) -> None:
    digest = experiments.mixture_document(predicted, mixture_id(predicted)).runs[0].digest
    with predicted.write() as session:
        session.execute(sa.update(Run).where(Run.specimen_hash == digest).values(specimen=text))
    with pytest.raises(ProtocolError, match="is no specimen of this version"):
        of_mixture(predicted)


def test_a_prediction_of_an_older_engine_is_outdated(pebbles: Store) -> None:
    experiments.predict(pebbles, FormulaRunner(pebbles, 1), [EQUAL])
    experiments.calibrate(pebbles, FormulaRunner(pebbles, 2), ["pebbles M"])
    for read in (of_mixture(pebbles), of_aggregate(pebbles)):
        assert report.STATES["outdated"] in read.text
        assert "by an older engine (version 1); run 'pdlab refresh'" in read.text


def test_a_failed_prediction_says_why_and_shows_the_rest(pebbles: Store, tmp_path: Path) -> None:
    (tmp_path / "packing_tests.csv").write_text("material,compaction,packing_density\npebbles F,loose,0.47\n")
    experiments.register(pebbles, read_path(tmp_path / "packing_tests.csv"))
    experiments.predict(pebbles, FormulaRunner(pebbles), [EQUAL])
    for read in (of_mixture(pebbles), of_aggregate(pebbles)):
        assert marks(read) == (2, True)
        assert report.STATES["failed"] in read.text
        assert "packing density 0.47 is out of reach of 'monosized'" in read.text
        assert "20.32 100" in read.text
        assert [tag for tag, _ in read.elements].count("img") >= 2


def test_without_a_prediction_a_calibration_or_tests_a_report_says_so_and_shows_the_rest(
    pebbles: Store, tmp_path: Path
) -> None:
    (tmp_path / "aggregates.csv").write_text("name\nbare\n")
    experiments.register(pebbles, read_path(tmp_path / "aggregates.csv"))
    parts = ids(pebbles, "bare", "pebbles F")
    made = experiments.register_mixture(pebbles, "half bare", parts, [0.5, 0.5], by_mass=False)
    read = Read(report.mixture(pebbles, made, at=AT))
    assert marks(read) == (2, True)
    for said in ("not predicted yet: run 'pdlab predict'", "bare was not sieved", "The mixture was not measured",
                 "No sieve analysis of it", "No density test of it", "particle density of bare", "'bare' has no sieve",
                 "No bed of it was simulated", "20.32 100"):  # fmt: skip
        assert said in read.text, said
    alone = of_aggregate(pebbles, "bare")
    assert marks(alone) == (2, True)
    assert "aggregate 'bare' has no sieve analysis; enter one" in alone.text
    assert "not calibrated yet: run 'pdlab calibrate'" in of_aggregate(pebbles).text
    for text in (read.text, alone.text):
        assert "None" not in text


def test_a_wish_that_has_not_ended_is_named(predicted: Store) -> None:
    assert "has not ended" not in of_mixture(predicted).text
    assert experiments.ask_prediction(predicted, mixture_id(predicted), "graded") == ""
    assert "A prediction by graded is asked for and has not ended" in of_mixture(predicted).text
    assert experiments.ask_calibration(predicted, ids(predicted, "pebbles F")[0], "monosized_rolling") == ""
    assert "A calibration by monosized_rolling is asked for and has not ended" in of_aggregate(predicted).text


def test_a_mixture_is_reported_by_the_method_asked_for_beside_the_others(predicted: Store) -> None:
    experiments.predict(predicted, FormulaRunner(predicted), [EQUAL], Way("graded"))
    for asked, shown in ((None, "graded"), ("monosized", "monosized"), ("graded", "graded")):
        read = of_mixture(predicted, asked)
        assert f"Predicted by the method {shown}, finished" in read.text
        for one in experiments.comparisons(predicted, names=[EQUAL]):
            assert f"predicted, {one.method} {one.packing_density:.4f}" in read.text
    missing = of_mixture(predicted, "monosized_rolling")
    assert marks(missing) == (2, True)
    assert "not predicted by 'monosized_rolling' yet: run 'pdlab predict --method monosized_rolling'" in missing.text
    with pytest.raises(InputError, match="'guess' is no method"):
        of_mixture(predicted, "guess")


def test_a_prediction_that_rests_on_an_older_calibration_shows_no_curve_of_a_newer_one(predicted: Store) -> None:
    before = [tag for tag, _ in of_mixture(predicted).elements].count("img")
    experiments.calibrate(predicted, FormulaRunner(predicted), ["pebbles F"], Way("graded"))
    read = of_mixture(predicted)
    assert [tag for tag, _ in read.elements].count("img") == before - 1
    assert "It was calibrated anew since" in read.text


def test_what_was_sieved_anew_stands_beside_what_the_calibration_rests_on(predicted: Store, tmp_path: Path) -> None:
    for passing in (98, 99):
        (tmp_path / "sieves.csv").write_text(
            f"aggregate,aperture_mm,passing_percent\npebbles F,20.32,100\npebbles F,16,{passing}\npebbles F,10.16,0\n"
        )
        experiments.register(predicted, read_path(tmp_path / "sieves.csv"))
    document = experiments.aggregate_document(predicted, ids(predicted, "pebbles F")[0])
    assert [test.current for test in document.inputs.sieves] == [False, True]
    assert document.inputs.other_sieves == 1
    assert document.calibration is not None
    assert document.inputs.sieves[0].key == document.calibration.sieve_analysis
    assert "1 further sieve analyses are in the store" in of_aggregate(predicted).text


def test_a_correction_stands_in_the_report(predicted: Store) -> None:
    experiments.correct(predicted, {"packing_test:3": {"voids_percent": "41.6"}}, "Anna", "misread")
    experiments.correct(predicted, {"mixture_component:2/0": {"solid_volume_share": "0.55"},
                                    "mixture_component:2/1": {"solid_volume_share": "0.45"}}, "Bert")  # fmt: skip
    assert "Anna packing_test:3 voids_percent 41.7 41.6 misread" in of_aggregate(predicted).text
    assert "Bert mixture_component:2/0 solid_volume_share 0.5 0.55" in of_mixture(predicted).text


def test_what_is_not_there_and_a_date_without_a_zone_are_refused(predicted: Store) -> None:
    with pytest.raises(UnknownName, match="no mixture 99"):
        report.mixture(predicted, 99)
    with pytest.raises(UnknownName, match="no aggregate 99"):
        report.aggregate(predicted, 99)
    with pytest.raises(InputError, match="has no zone"):
        report.mixture(predicted, mixture_id(predicted), at=dt.datetime(2026, 3, 31))
    assert re.search(r"made on \d{4}-\d\d-\d\d \d\d:\d\d:\d\d \(UTC[+-]\d\d:\d\d\)",
                     Read(report.mixture(predicted, mixture_id(predicted))).text)  # fmt: skip


def test_every_method_rule_and_compaction_is_explained_in_a_sentence() -> None:
    assert set(methods.METHODS) == {*METHODS, *OTHERS, *REFERENCES}
    assert set(methods.RULES) == set(RULES)
    assert set(methods.COMPACTIONS) >= {*COMPACTIONS, "repose", *REFERENCES} - {"unstated"}


@both
def test_a_snapshot_sees_one_state_whatever_is_written_meanwhile(opened: Store, tmp_path: Path) -> None:
    with opened.snapshot() as frozen:
        assert experiments.counted(frozen, "aggregates") == 0
        experiments.register(opened, read_path(SHIPPED))
        assert experiments.counted(frozen, "aggregates") == 0
        assert experiments.counted(opened, "aggregates") == 3
        with pytest.raises(UnknownName):
            report.named(frozen, "pebbles F")
    check_alone(report.named(opened, EQUAL))
    with opened.snapshot() as frozen:
        assert experiments.counted(frozen, "aggregates") == 3


def test_the_verb_writes_a_report_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with Lab(tmp_path / "pdlab.db") as lab:
        lab.import_tables(SHIPPED)
        experiments.predict(lab.store, FormulaRunner(lab.store), [EQUAL])
        made = lab.report(EQUAL, at=AT)
    out = tmp_path / "out.html"
    cli.descent.report(EQUAL, out, None, str(tmp_path / "pdlab.db"))
    assert capsys.readouterr().out == f"written to {out}\n"
    assert Read(out.read_text(encoding="utf-8")).shape() == Read(made).shape()
    refused(pdlab("report", EQUAL, "-o", "out.html", folder=tmp_path), "out.html is there and would be overwritten")


def test_the_sentences_of_what_is_refused(tmp_path: Path) -> None:
    with Lab(tmp_path / "pdlab.db") as lab:
        lab.import_tables(SHIPPED)
        with pytest.raises(InputError, match=r"no-such/out\.html cannot be written"):
            lab.report("pebbles L", tmp_path / "no-such" / "out.html")
        with pytest.raises(InputError, match=r"out\.txt does not end in \.html"):
            lab.report("pebbles L", tmp_path / "out.txt")
        with pytest.raises(UnknownName, match="holds nothing named 'gravel'"):
            lab.report("gravel")
        with pytest.raises(InputError, match="'pebbles L' is an aggregate, whose report holds its last calibration"):
            lab.report("pebbles L", method="graded")
        with pytest.raises(InputError, match="a prediction \\('prediction:1'\\) cannot be named here"):
            lab.report("prediction:1")
        with lab.store.write() as session:
            (row,) = store_module.aggregates(session, ["pebbles L"])
            row.name = EQUAL
        with pytest.raises(InputError, match="names several things; write one of mixture:"):
            lab.report(EQUAL)
        assert "<h1>Aggregate pebbles L+F 1:1</h1>" in lab.report(f"aggregate:{EQUAL}")


def test_a_file_that_stands_for_a_report_says_why() -> None:
    html = report.refused("the store <away>; try again")
    check_alone(html)
    assert "the store <away>; try again" in Read(html).text
