"""A calibration is explained by its curve and runs; a wish for one is written, watched and cancelled."""

import math
from pathlib import Path

import pytest
from conftest import FormulaRunner, formula_density
from streamlit.testing.v1 import AppTest
from streamlit.util import calc_hash
from test_page import PAGE, lab

from pdlab import charts, experiments
from pdlab import store as store_module
from pdlab.dem import VERSION
from pdlab.errors import UnknownName
from pdlab.experiments import Way
from pdlab.lab import SHIPPED
from pdlab.page import choosing
from pdlab.store import Store
from pdlab.tables import read_path

__all__ = ["lab"]


def aggregate(target: Store, name: str = "pebbles F") -> int:
    with target.read() as session:
        return store_module.aggregates(session, [name])[0].id


def test_a_calibration_is_explained_by_the_curve_and_the_runs_it_rests_on(pebbles: Store) -> None:
    (report,) = experiments.calibrate(pebbles, FormulaRunner(pebbles), ["pebbles F"])
    known = experiments.explain(pebbles, report.aggregate_id)
    assert report.result is not None
    assert (known.value, known.low, known.high) == (report.result.value, report.result.low, report.result.high)
    assert known.curve is not None
    for node in known.curve.nodes:
        assert node.mean == pytest.approx(math.fsum(node.runs) / len(node.runs))
        assert node.mean == pytest.approx(formula_density(node.value), abs=0.0015)
    assert min(known.curve.values) == known.curve.nodes[0].value
    assert max(known.curve.values) == known.curve.nodes[-1].value
    nearest = min(range(60), key=lambda k: abs(known.curve.values[k] - (known.value or 0.0)))  # type: ignore[union-attr]
    assert known.curve.means[nearest] == pytest.approx(known.measured, abs=0.002)
    assert all(error > 0.0 for error in known.curve.errors)
    assert (known.method, known.message) == ("monosized", "")
    assert "the simplest method" in known.why


def test_before_a_calibration_the_curve_of_others_and_the_measured_value_are_shown(pebbles: Store) -> None:
    experiments.calibrate(pebbles, FormulaRunner(pebbles), ["pebbles F"])
    known = experiments.explain(pebbles, aggregate(pebbles, "pebbles L"))
    assert (known.method, known.value, known.measured) == ("", None, pytest.approx(0.6))
    assert known.curve is not None


def test_what_is_out_of_reach_is_explained_with_its_curve(pebbles: Store, tmp_path: Path) -> None:
    (tmp_path / "packing_tests.csv").write_text("material,compaction,packing_density\npebbles F,loose,0.47\n")
    experiments.register(pebbles, read_path(tmp_path / "packing_tests.csv"))
    experiments.calibrate(pebbles, FormulaRunner(pebbles), ["pebbles F"])
    known = experiments.explain(pebbles, aggregate(pebbles))
    assert known.value is None
    assert known.message.startswith("packing density 0.47 is out of reach of 'monosized': ")
    assert known.curve is not None
    experiments.calibrate(pebbles, FormulaRunner(pebbles), ["pebbles F"], Way("auto"))
    rolling = experiments.explain(pebbles, aggregate(pebbles))
    assert (rolling.method, rolling.curve and rolling.curve.coefficient) == ("monosized_rolling", "rolling")
    assert "are not as loose: rolling resistance is added" in rolling.why


def test_a_calibration_to_older_tests_says_so(pebbles: Store, tmp_path: Path) -> None:
    experiments.calibrate(pebbles, FormulaRunner(pebbles), ["pebbles F"])
    (tmp_path / "packing_tests.csv").write_text("material,compaction,packing_density\npebbles F,loose,0.59\n")
    experiments.register(pebbles, read_path(tmp_path / "packing_tests.csv"))
    assert any("calibrate again" in note for note in experiments.explain(pebbles, aggregate(pebbles)).notes)


def test_a_calibration_of_an_older_engine_says_so_and_keeps_its_runs(pebbles: Store) -> None:
    experiments.calibrate(pebbles, FormulaRunner(pebbles), ["pebbles F"])
    before = experiments.explain(pebbles, aggregate(pebbles))
    experiments.calibrate(pebbles, FormulaRunner(pebbles, VERSION + 1), ["pebbles L"])
    after = experiments.explain(pebbles, aggregate(pebbles))
    assert after.curve == before.curve
    assert after.notes == (*before.notes, f"by an older engine (version {VERSION}); run 'pdlab refresh'")


def test_an_aggregate_without_a_test_says_what_is_missing(pebbles: Store, tmp_path: Path) -> None:
    (tmp_path / "aggregates.csv").write_text("name\nbare\n")
    experiments.register(pebbles, read_path(tmp_path / "aggregates.csv"))
    bare = aggregate(pebbles, "bare")
    known = experiments.explain(pebbles, bare)
    assert (known.curve, known.message) == (None, "aggregate 'bare' has no sieve analysis; enter one")
    assert experiments.ask_calibration(pebbles, bare, "auto") == known.message
    assert experiments.waiting_calibration(pebbles, bare) is None
    for call in (experiments.explain, lambda target, key: experiments.ask_calibration(target, key, "auto")):
        with pytest.raises(UnknownName, match="no aggregate 99"):
            call(pebbles, 99)


def test_a_wish_is_written_once_watched_and_cancelled(pebbles: Store) -> None:
    wanted = aggregate(pebbles)
    for _ in range(2):
        assert experiments.ask_calibration(pebbles, wanted, "auto") == ""
    waiting = experiments.waiting_calibration(pebbles, wanted)
    assert waiting is not None
    assert (waiting.method, waiting.state, waiting.progress) == ("auto", "queued", 0.0)
    assert experiments.cancel(pebbles, [waiting.key]) == 1
    assert experiments.waiting_calibration(pebbles, wanted) is None


def view(asked: int | str) -> AppTest:
    app = AppTest.from_file(str(PAGE), default_timeout=60)
    app._page_hash = calc_hash("calibration")
    app.query_params["aggregate"] = str(asked)
    app.run()
    assert not app.exception
    return app


def test_the_page_wishes_for_a_calibration_and_cancels_it(lab: Store) -> None:
    experiments.register(lab, read_path(SHIPPED))
    wanted = aggregate(lab, "pebbles M")
    app = view(wanted)
    assert app.selectbox(key="aggregate").value == wanted
    assert any("Nothing of its curve is simulated yet" in info.value for info in app.info)
    app.button(key="calibrate").click().run()
    waiting = experiments.waiting_calibration(lab, wanted)
    assert waiting is not None
    app.button(key="cancel").click().run()
    assert experiments.waiting_calibration(lab, wanted) is None
    assert app.button(key="calibrate")


def test_the_page_shows_the_coefficient_with_its_interval(lab: Store, tmp_path: Path) -> None:
    experiments.register(lab, read_path(SHIPPED))
    (report,) = experiments.calibrate(lab, FormulaRunner(lab), ["pebbles F"])
    app = view(report.aggregate_id)
    assert report.result is not None
    assert app.metric[0].value == f"{report.result.value:.4f}"
    assert app.metric[0].delta == f"its interval: {report.result.low:.4f} to {report.result.high:.4f}"
    assert app.metric[1].label.endswith(", measured"), "in a compaction that is not stated"
    assert app.metric[1].value == "0.5830 ± 0.0050", "as many digits as the error has"
    (tmp_path / "packing_tests.csv").write_text("material,compaction,voids_percent\npebbles F,rodded,41.7\n")
    experiments.register(lab, read_path(tmp_path / "packing_tests.csv"))
    experiments.calibrate(lab, FormulaRunner(lab), ["pebbles F"])
    assert view(report.aggregate_id).metric[1].label.endswith(", measured rodded")
    (link,) = app.get("page_link")
    assert link.proto.label.replace("\\", "") == "Add a sieve analysis or a density test of pebbles F"
    assert "monosized" in app.markdown[0].value


def test_the_page_says_which_method_was_tried_and_what_reaches(lab: Store, tmp_path: Path) -> None:
    experiments.register(lab, read_path(SHIPPED))
    (tmp_path / "packing_tests.csv").write_text("material,compaction,packing_density\npebbles F,loose,0.47\n")
    experiments.register(lab, read_path(tmp_path / "packing_tests.csv"))
    experiments.calibrate(lab, FormulaRunner(lab), ["pebbles F"])
    app = view(aggregate(lab))
    assert "use the method 'monosized_rolling', or 'auto'" in app.warning[0].value.replace("\\", "")
    assert app.markdown[0].value.replace("\\", "").startswith("Method tried: monosized, equal spheres")


def test_an_address_of_no_aggregate_is_a_sentence(lab: Store) -> None:
    assert any("holds no aggregate yet" in info.value for info in view("").info)
    experiments.register(lab, read_path(SHIPPED))
    assert any("no aggregate 99" in error.value for error in view(99).error)


def test_a_calibration_chart_holds_every_run_and_what_was_measured(pebbles: Store) -> None:
    (report,) = experiments.calibrate(pebbles, FormulaRunner(pebbles), ["pebbles F"])
    known = experiments.explain(pebbles, report.aggregate_id)
    assert known.curve is not None
    figure = charts.calibration_curve(known, known.curve)
    runs = next(trace for trace in figure.data if trace.name == "runs")
    assert sorted(runs.y) == sorted(run for node in known.curve.nodes for run in node.runs)
    measured = next(shape for shape in figure.layout.shapes if shape.type == "rect" and shape.xref == "x domain")
    assert known.measured is not None
    assert known.measured_error is not None
    ends = known.measured - known.measured_error, known.measured + known.measured_error
    assert (measured.y0, measured.y1) == pytest.approx(ends)


def test_an_aggregate_too_old_for_the_list_is_shown_by_its_address(lab: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    experiments.register(lab, read_path(SHIPPED))
    monkeypatch.setattr(choosing, "LISTED", 1)
    oldest = aggregate(lab, "pebbles L")
    app = view(oldest)
    assert app.selectbox(key="aggregate").value == oldest
    assert app.selectbox(key="aggregate").options == ["pebbles F", "pebbles L"]
