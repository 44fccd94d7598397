"""The view of mixtures by AppTest: put together, saved, wished for, watched, cancelled, come back to, read."""

import datetime as dt
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from conftest import FormulaPool, FormulaRunner
from hypothesis import given
from hypothesis import strategies as st
from streamlit.testing.v1 import AppTest
from streamlit.util import calc_hash
from test_mixing import dense, ids, keep_bed, set_wish
from test_page import PAGE, lab, plain

from pdlab import experiments
from pdlab import store as store_module
from pdlab.batch.runner import Runner
from pdlab.batch.working import answer
from pdlab.experiments import Pace, Way
from pdlab.lab import SHIPPED
from pdlab.models import now
from pdlab.page import watching
from pdlab.page.watching import duration, ordinal
from pdlab.store import Store
from pdlab.tables import read_path

__all__ = ["lab"]
EQUAL = "pebbles L+F 1:1"


@pytest.fixture
def stocked(lab: Store) -> Store:
    experiments.register(lab, read_path(SHIPPED))
    return lab


def view(asked: int | str = "") -> AppTest:
    app = AppTest.from_file(str(PAGE), default_timeout=60)
    app._page_hash = calc_hash("mixtures")
    if asked:
        app.query_params["mixture"] = str(asked)
    return ran(app)


def ran(one: Any) -> AppTest:
    """Run the page after what was done to one of its elements, or as it stands."""
    app: AppTest = one.run()
    assert not app.exception
    return app


def chosen(target: Store, *names: str, **texts: str) -> AppTest:
    app = view()
    app.multiselect(key="parts").set_value(ids(target, *names))
    ran(app)
    for key, text in texts.items():
        app.text_input(key=key).set_value(text)
    return ran(app)


def share(app: AppTest, k: int, text: str) -> AppTest:
    """Type the share of the aggregate chosen as number k."""
    boxes = [box for box in app.text_input if box.key and box.key.startswith("share_")]
    boxes[k].set_value(text)
    return ran(app)


def metrics(app: AppTest) -> dict[str, str]:
    return {metric.label.replace("\\", ""): metric.value for metric in app.metric}


def said(app: AppTest) -> list[str]:
    blocks = (*app.info, *app.warning, *app.caption, *app.error)
    return [block.value.replace("\\", "") for block in blocks]


def mixture(target: Store, name: str = EQUAL) -> int:
    return next(key for key, known in experiments.mixture_names(target, 100).items() if known == name)


def charted(app: AppTest) -> int:
    return len(app.get("plotly_chart"))


def test_without_two_aggregates_there_is_nothing_to_mix(lab: Store) -> None:
    assert any("takes two aggregates or more" in text for text in said(view()))


def test_shares_begin_equal_and_the_last_is_always_the_rest(stocked: Store) -> None:
    app = chosen(stocked, "pebbles L", "pebbles M", "pebbles F")
    assert metrics(app) == {"pebbles F: the rest [%]": "33.34"}
    assert metrics(share(share(app, 0, "60"), 1, "12,5")) == {"pebbles F: the rest [%]": "27.5"}
    assert charted(app) == 1
    ran(app.multiselect(key="parts").set_value(ids(stocked, "pebbles L", "pebbles F")))
    assert metrics(app) == {"pebbles F: the rest [%]": "50"}


def test_fewer_than_two_aggregates_are_asked_to_be_more(stocked: Store) -> None:
    assert any("Choose two to five aggregates" in text for text in said(chosen(stocked, "pebbles L")))


@pytest.mark.parametrize(
    ("first", "second", "rest", "sentence"),
    [
        ("60", "50", "-10", "the others sum to 110 %, which leaves -10 %"),
        ("much", "50", "?", "'much' is no number"),
        ("-5", "50", "?", "-5 must be above 0"),
    ],
)
def test_shares_that_cannot_be_are_sentences_and_nothing_can_be_saved(
    stocked: Store, first: str, second: str, rest: str, sentence: str
) -> None:
    app = share(share(chosen(stocked, "pebbles L", "pebbles M", "pebbles F"), 0, first), 1, second)
    assert [text.startswith(sentence) for text in plain(app)[1]] == [True]
    assert metrics(app) == {"pebbles F: the rest [%]": rest}
    assert not [button for button in app.button if button.key == "save"]


def test_shares_by_mass_without_a_particle_density_say_what_is_missing(stocked: Store, tmp_path: Path) -> None:
    app = chosen(stocked, "pebbles L", "pebbles F", mixture_name="heavy")
    ran(app.radio(key="basis").set_value("mass"))
    assert any("need a particle density of pebbles L, pebbles F" in text for text in plain(app)[1])
    dense(stocked, tmp_path)
    share(app, 0, "60")
    ran(app.button(key="save").click())
    assert experiments.composition(stocked, mixture(stocked, "heavy")).shares == pytest.approx((0.5, 0.5))


def test_a_saved_mixture_is_opened_and_its_address_can_be_come_back_to(stocked: Store) -> None:
    app = share(chosen(stocked, "pebbles L", "pebbles F", mixture_name="Mine"), 0, "62,5")
    ran(app.button(key="save").click())
    made = mixture(stocked, "Mine")
    assert app.query_params["mixture"] in (str(made), [str(made)])
    assert app.selectbox(key="mixture").value == made
    for one in (app, view(made)):
        (table,) = [block.value for block in one.table if "by solid volume [%]" in block.value]
        assert dict(table["by solid volume [%]"]) == {"pebbles L": "62.5", "pebbles F": "37.5"}
        assert any("Not predicted yet" in text for text in said(one))
    ran(app.selectbox(key="mixture").set_value(0))
    assert "mixture" not in app.query_params
    assert app.multiselect(key="parts")


def test_a_mixture_without_a_name_or_with_that_of_another_is_refused(stocked: Store) -> None:
    app = chosen(stocked, "pebbles L", "pebbles F")
    ran(app.button(key="save").click())
    assert plain(app)[1] == ["the mixture has no name; enter one"]
    app.text_input(key="mixture_name").set_value("two\nlines")
    ran(app.button(key="save").click())
    (once,) = plain(app)[1]
    assert "holds characters that cannot be shown" in once
    app.text_input(key="mixture_name").set_value("pebbles M+F 1:1")
    ran(app.button(key="save").click())
    assert any("is there with other shares or aggregates; give this one another name" in text for text in plain(app)[1])
    assert len(experiments.mixture_names(stocked, 100)) == 3


def test_an_address_of_no_mixture_is_a_sentence(stocked: Store) -> None:
    assert any("no mixture 99" in text for text in plain(view(99))[1])


def test_a_wish_is_watched_cancelled_and_asked_for_again(stocked: Store) -> None:
    asked = mixture(stocked)
    app = view(asked)
    ran(app.button(key="predict").click())
    waiting = experiments.waiting_prediction(stocked, asked)
    assert waiting is not None
    assert (waiting.method, waiting.state) == ("auto", "queued")
    assert not any("No runner is at work" in text for text in said(app)), "one may take it up any moment"
    app = view(asked)  # come back by the address
    assert not [button for button in app.button if button.key == "predict"]
    ran(app.button(key="cancel").click())
    assert experiments.waiting_prediction(stocked, asked) is None
    assert app.button(key="predict")


def progress(app: AppTest) -> str:
    (bar,) = app.get("progress")
    return str(bar.proto.text).replace("\\", "")


def test_how_far_a_wish_is_and_how_long_it_takes_is_said(stocked: Store) -> None:
    asked = mixture(stocked)
    experiments.ask_prediction(stocked, asked, "monosized")
    waiting = experiments.waiting_prediction(stocked, asked)
    assert waiting is not None
    moment = now()
    begun = moment - dt.timedelta(minutes=2)
    set_wish(stocked, waiting.key[1], state="running", requested_at=begun, heartbeat=moment, progress=0.4)
    app = view(asked)
    assert progress(app) == "monosized, running, 40 %, at most 3 min left"
    assert not any("No runner" in text for text in said(app))


def test_time_left_is_that_of_the_work_and_not_of_the_queue(stocked: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = mixture(stocked)
    experiments.ask_prediction(stocked, asked, "monosized")
    waiting = experiments.waiting_prediction(stocked, asked)
    assert waiting is not None
    clock = iter([100.0, 110.0, 130.0])
    monkeypatch.setattr(watching, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    begun = now() - dt.timedelta(hours=5)
    app, seen = AppTest.from_file(str(PAGE), default_timeout=60), list[str]()
    app._page_hash = calc_hash("mixtures")
    app.query_params["mixture"] = str(asked)
    for share in (0.1, 0.2, 0.4):
        set_wish(stocked, waiting.key[1], state="running", requested_at=begun, heartbeat=now(), progress=share)
        seen.append(progress(ran(app)))
    assert seen == [
        "monosized, running, 10 %, at most 45.0 h left",
        "monosized, running, 20 %, at most 20.0 h left",
        "monosized, running, 40 %, about 1 min left",
    ]


@given(st.lists(st.floats(0.01, 0.2), min_size=3, max_size=8), st.floats(0.5, 500.0))
def test_a_steady_pace_tells_what_is_left_and_one_that_falls_back_begins_anew(steps: list[float], slow: float) -> None:
    pace, moment, share = Pace(0.0), 0.0, 0.0
    for step in (one * 0.9 / sum(steps) for one in steps):
        moment, share = moment + slow * step, share + step
        pace = pace.look(moment, share)
    assert pace.left == pytest.approx(slow * (1.0 - share))
    assert pace.look(moment + 1.0, share) == pace
    assert pace.look(moment + 1.0, 0.0) == Pace(0.0)


def test_a_wish_that_nobody_takes_up_says_what_to_start(stocked: Store) -> None:
    asked = mixture(stocked)
    experiments.ask_prediction(stocked, asked, "monosized")
    waiting = experiments.waiting_prediction(stocked, asked)
    assert waiting is not None
    set_wish(stocked, waiting.key[1], requested_at=now() - dt.timedelta(minutes=1))
    app = view(asked)
    assert progress(app) == "monosized, 1st in line: it begins when a runner is free"
    assert any("`pdlab runner` or `pdlab serve`" in text for text in said(app))


def test_what_is_refused_is_a_sentence(stocked: Store, tmp_path: Path) -> None:
    (tmp_path / "aggregates.csv").write_text("name\nbare\n")
    experiments.register(stocked, read_path(tmp_path / "aggregates.csv"))
    parts = ids(stocked, "bare", "pebbles F")
    made = experiments.register_mixture(stocked, "half bare", parts, [0.5, 0.5], by_mass=False)
    app = view(made)
    assert any("No sieve analysis of bare" in text for text in said(app))
    ran(app.button(key="predict").click())
    experiments.predict(stocked, FormulaRunner(stocked), ["half bare"])
    failed = (
        "aggregate 'bare' of mixture 'half bare' is not calibrated: aggregate 'bare' has no sieve analysis; enter one"
    )
    app = view(made)
    assert f"Before this one: {failed}" in said(app), "it is asked for a second time"
    ran(app.button(key="cancel").click())
    assert failed in said(app)


def test_nobody_is_told_to_ask_for_what_is_asked_for(stocked: Store, tmp_path: Path) -> None:
    asked = mixture(stocked)
    experiments.predict(stocked, FormulaRunner(stocked))
    (tmp_path / "packing_tests.csv").write_text("material,compaction,voids_percent\npebbles L,loose,41\n")
    experiments.register(stocked, read_path(tmp_path))
    app, outdated = view(asked), "pebbles L: tested or sieved anew since, or corrected"
    assert f"{outdated}; press 'Predict' again" in said(app)
    ran(app.button(key="predict").click())
    assert f"Before this one: {outdated}" in said(app)


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.2, "1 s"), (59.0, "59 s"), (90.0, "2 min"), (3599.0, "60 min"), (5400.0, "1.5 h")]
)
def test_time_left_is_said_in_the_unit_that_people_use(seconds: float, text: str) -> None:
    assert duration(seconds) == text


@pytest.mark.parametrize(("number", "text"), [(1, "1st"), (2, "2nd"), (3, "3rd"), (11, "11th"), (22, "22nd")])
def test_a_place_in_line_is_said_as_people_say_it(number: int, text: str) -> None:
    assert ordinal(number) == text


def test_a_runner_answers_the_wish_and_the_result_says_what_paste_must_fill(stocked: Store, tmp_path: Path) -> None:
    dense(stocked, tmp_path)
    asked = mixture(stocked)
    app = view(asked)
    ran(app.selectbox(key="way").set_value("monosized"))
    ran(app.button(key="predict").click())
    waiting = experiments.waiting_prediction(stocked, asked)
    assert waiting is not None
    runner = Runner(stocked, FormulaPool())
    list(answer(runner, [waiting.key]))
    runner.close()
    app = view(asked)
    (report,) = [one for one in experiments.comparisons(stocked) if one.mixture == EQUAL]
    assert report.packing_density is not None
    assert report.expected_error is not None
    packing, error = report.packing_density, report.expected_error
    assert [(metric.label.replace("\\", ""), metric.value, metric.delta) for metric in app.metric] == [
        ("Predicted PD", f"{packing:.4f}", f"± {error:.4f}"),
        ("Voids [%]", f"{100 * (1 - packing):.1f}", f"± {100 * error:.1f}"),
        ("Bulk density [kg/m³]", f"{2500 * packing:.0f}", f"± {2500 * error:.0f}"),
        ("Voids for paste [L/m³]", f"{1000 * (1 - packing):.0f}", f"± {1000 * error:.0f}"),
    ]
    (table,) = [block.value for block in app.table if "minus measured" in block.value]
    assert list(table.index) == ["predicted PD", "measured PD", "volume mean", "Furnas", "Toufar", "CPM"]
    assert table.loc["predicted PD", "minus measured"] == f"{report.difference:+.4f}"
    assert table.loc["measured PD", "minus measured"] == ""


def test_an_unknown_particle_density_leaves_only_the_bulk_density_out(stocked: Store) -> None:
    experiments.predict(stocked, FormulaRunner(stocked), [EQUAL])
    app = view(mixture(stocked))
    assert metrics(app)["Bulk density [kg/m³]"] == "unknown"
    assert any("the particle density of pebbles L, pebbles F is missing" in text for text in said(app))


def test_warnings_of_a_prediction_are_sentences(stocked: Store, tmp_path: Path) -> None:
    experiments.predict(stocked, FormulaRunner(stocked), [EQUAL])
    (tmp_path / "packing_tests.csv").write_text("material,compaction,packing_density\npebbles L,loose,0.61\n")
    experiments.register(stocked, read_path(tmp_path / "packing_tests.csv"))
    warned = [warning.value.replace("\\", "") for warning in view(mixture(stocked)).warning]
    assert any("pebbles L: tested or sieved anew since, or corrected; press 'Predict' again" in text for text in warned)


def test_every_method_and_every_theory_says_what_it_is(stocked: Store) -> None:
    app = view(mixture(stocked))
    box = app.selectbox(key="way")
    assert all(f"- {name}: " in box.help for name in box.options)
    assert any("Furnas: packing density after Furnas, an upper bound. Toufar: " in text for text in said(app))


def test_a_mixture_tested_in_another_compaction_than_its_beds_says_so(stocked: Store, tmp_path: Path) -> None:
    experiments.predict(stocked, FormulaRunner(stocked), [EQUAL])
    (tmp_path / "packing_tests.csv").write_text(f"material,compaction,packing_density\n{EQUAL},rodded,0.68\n")
    experiments.register(stocked, read_path(tmp_path / "packing_tests.csv"))
    warned = [warning.value.replace("\\", "") for warning in view(mixture(stocked)).warning]
    assert warned == ["The mixture's density test is rodded, its beds are loose: the difference is of both"]


def test_predictions_by_several_methods_are_shown_one_at_a_time(stocked: Store) -> None:
    for method in ("monosized", "graded"):
        experiments.predict(stocked, FormulaRunner(stocked), [EQUAL], Way(method))
    app = view(mixture(stocked))
    by_method = {one.method: one for one in experiments.comparisons(stocked, names=[EQUAL])}
    box = app.radio(key=f"method_{EQUAL}")
    assert sorted(box.options) == ["graded", "monosized"]
    for method in box.options:
        ran(app.radio(key=f"method_{EQUAL}").set_value(method))
        assert metrics(app)["Predicted PD"] == f"{by_method[method].packing_density:.4f}"


def test_a_mixture_that_was_not_measured_says_so(stocked: Store) -> None:
    parts = ids(stocked, "pebbles L", "pebbles F")
    made = experiments.register_mixture(stocked, "new", parts, [0.3, 0.7], by_mass=False)
    app = view(made)
    assert any("was not measured. To compare, enter a density test of it below" in text for text in said(app))
    assert {"volume mean", "Toufar"} & {name for block in app.table for name in block.value.index}


def test_the_bed_is_drawn_only_when_it_is_asked_for(stocked: Store) -> None:
    (report,) = experiments.predict(stocked, FormulaRunner(stocked), [EQUAL])
    assert report.prediction_id is not None
    app = view(mixture(stocked))
    before, key = charted(app), f"bed_{report.prediction_id}"
    ran(app.toggle(key=key).set_value(True))
    assert any("no bed of the prediction" in text for text in plain(app)[1])
    assert charted(app) == before
    run = keep_bed(stocked, report.prediction_id, 40)
    ran(app)
    assert charted(app) == before + 1
    assert any(text.startswith(f"Run {run.specimen_hash[:12]}, seed 1: all 40 spheres") for text in said(app))
    ran(app.toggle(key=key).set_value(False))
    assert charted(app) == before


def test_the_page_reads_what_another_session_saved(stocked: Store) -> None:
    parts = ids(stocked, "pebbles L", "pebbles F")
    app = view()
    made = experiments.register_mixture(stocked, "theirs", parts, [0.3, 0.7], by_mass=False)
    ran(app)
    assert any("theirs" in option for option in app.selectbox(key="mixture").options)
    with stocked.read() as session:
        assert store_module.find_mixture(session, "theirs") is not None
    assert view(made).selectbox(key="mixture").value == made
