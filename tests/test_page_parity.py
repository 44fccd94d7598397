"""The home page by AppTest: filters in the address, one click opens, several are listed, what is missing is told."""

import datetime as dt
import json
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from conftest import FormulaRunner
from streamlit.testing.v1 import AppTest
from streamlit.util import calc_hash
from test_page import PAGE, frame_of, lab, plain

from pdlab import experiments
from pdlab.experiments import Filters, Way
from pdlab.lab import SHIPPED
from pdlab.models import Prediction, now
from pdlab.page import filters, picking, watching
from pdlab.page.app import HOME
from pdlab.page.picking import OPENED, PICKED, Picked, picked
from pdlab.store import Store
from pdlab.tables import read_path

__all__ = ["lab"]
HOUR = dt.timedelta(hours=1)
SAID = "what there is to say"
LM, LF, MF = "pebbles L+M 1:1", "pebbles L+F 1:1", "pebbles M+F 1:1"


@pytest.fixture
def pebbles(lab: Store) -> Store:
    experiments.register(lab, read_path(SHIPPED))
    return lab


@pytest.fixture
def predicted(pebbles: Store) -> Store:
    for method in ("monosized", "graded"):
        experiments.predict(pebbles, FormulaRunner(pebbles), way=Way(method))
    return pebbles


def home(**query: str | list[str]) -> AppTest:
    app = AppTest.from_file(str(PAGE), default_timeout=60)
    app._page_hash = calc_hash(HOME)
    for key, value in query.items():
        app.query_params[key] = value
    return ran(app)


def ran(one: Any) -> AppTest:
    app: AppTest = one.run()
    assert not app.exception
    return app


def test_what_is_not_predicted_says_what_to_press(pebbles: Store) -> None:
    assert set(frame_of(home(), SAID)["what there is to say"]) == {"not predicted yet: press 'Predict'"}


def listed(app: AppTest) -> list[str]:
    return list(frame_of(app, SAID)["mixture"])


def drawn(app: AppTest) -> list[dict[str, Any]]:
    """The series of the chart that can be clicked."""
    (chart,) = app.get("plotly_chart")
    return [series for series in json.loads(chart.proto.spec)["data"] if "customdata" in series]


def test_mixtures_that_are_not_predicted_are_counted_and_lead_to_their_prediction(pebbles: Store) -> None:
    app = home()
    assert any("3 mixtures are measured and not predicted yet" in info.value for info in app.info)
    assert [link.proto.label.replace("\\", "") for link in app.get("page_link")] == [LM, LF, MF]
    assert [link.proto.query_string for link in app.get("page_link")] == ["mixture=1", "mixture=2", "mixture=3"]
    assert any("None of these mixtures is both measured and predicted" in info.value for info in app.info)
    assert list(frame_of(app, SAID)["state"]) == ["open"] * 3


def test_what_is_asked_for_is_counted_apart_and_nobody_is_told_to_ask_again(pebbles: Store) -> None:
    for key in (1, 2):
        experiments.ask_prediction(pebbles, key, "monosized")
    set_wishes(pebbles, requested_at=now())
    app = home()
    said = [info.value for info in app.info]
    assert "2 mixtures are waiting for the runner." in said
    assert any(text.startswith("1 mixture is measured and not predicted yet") for text in said)
    assert [link.proto.query_string for link in app.get("page_link")] == ["mixture=3"]
    frame = frame_of(app, SAID).set_index("mixture")
    assert frame[SAID].to_dict() == {
        LM: "waiting for the runner", LF: "waiting for the runner", MF: "not predicted yet: press 'Predict'",
    }  # fmt: skip
    assert not app.warning


def test_predictions_that_run_and_a_runner_that_is_gone_are_told(pebbles: Store) -> None:
    experiments.ask_prediction(pebbles, 1, "monosized")
    set_wishes(pebbles, requested_at=now() - HOUR, state="running", heartbeat=now())
    app = home()
    assert "1 mixture is being predicted." in [info.value for info in app.info]
    assert not app.warning
    set_wishes(pebbles, heartbeat=now() - HOUR)
    assert [warning.value for warning in home().warning] == [watching.NOBODY]


def set_wishes(target: Store, **values: Any) -> None:
    with target.write() as session:
        session.execute(sa.update(Prediction).values(values))


def test_a_prediction_s_mixtures_stand_beside_their_measurements(predicted: Store) -> None:
    app = home(method="monosized")
    frame = frame_of(app, SAID)
    assert list(frame["mixture"]) == [MF, LF, LM]
    assert (frame["± expected"] > 0.0).all()
    assert list(frame["measured PD"].round(3)) == [0.621, 0.644, 0.642]
    assert [(metric.label.replace("\\", ""), metric.value) for metric in app.metric] == [
        ("Mean absolute error of monosized, 3 mixtures", f"{frame['difference'].abs().mean():.4f}"),
        ("The same for the volume mean of the aggregates", "0.0373"),
    ]


def test_all_methods_are_judged_and_the_chosen_ones_drawn(predicted: Store) -> None:
    app = home()
    assert [series["name"] for series in drawn(app)] == ["graded", "monosized"]
    ran(app.multiselect(key="method").set_value(["graded"]))
    assert [series["name"] for series in drawn(app)] == ["graded"]
    assert list(frame_of(app, SAID)["method"]) == ["graded"] * 3
    table = frame_of(app, "mixtures compared")
    assert list(table.index) == ["graded", "monosized"]
    assert list(table["mixtures compared"]) == ["3 of 3 measured"] * 2
    off = frame_of(app, SAID)["difference"]
    assert table["bias"].iloc[0].startswith(f"{off.mean():+.4f} ({off.min():+.4f} to {off.max():+.4f})")


def test_why_there_is_no_interval_is_said(predicted: Store) -> None:
    app = home(find="L+")
    table = frame_of(app, "mixtures compared")
    assert list(table["mean absolute"]) == [f"{frame_of(app, SAID)['difference'].abs().mean():.4f}"] * 2
    said = "No interval for graded, monosized: 2 mixtures say nothing of an interval, it takes 3."
    assert said in [caption.value.replace("\\", "") for caption in app.caption]


def test_filters_come_from_the_address_and_go_into_it(predicted: Store) -> None:
    app = home(find="l+", holds=["pebbles M", "pebbles F"], method="graded", since="2020-02-29")
    assert listed(app) == [LF, LM]
    assert app.date_input(key="since").value == dt.date(2020, 2, 29)
    ran(app.multiselect(key="holds").set_value(["pebbles F"]))
    assert listed(app) == [LF]
    assert dict(app.query_params) == {
        "find": "l+", "holds": "pebbles F", "method": "graded", "since": "2020-02-29",
    }  # fmt: skip
    ran(app.text_input(key="find").set_value(""))
    assert "find" not in app.query_params
    again = home(**app.query_params)
    assert listed(again) == listed(app) == [MF, LF]


def test_a_filter_of_the_address_that_the_store_does_not_know_finds_nothing(predicted: Store) -> None:
    app = home(holds="no such aggregate")
    assert app.multiselect(key="holds").value == ["no such aggregate"]
    assert any("No mixture meets all of these filters" in info.value for info in app.info)
    ran(app.button(key="clear").click())
    assert len(listed(app)) == 6
    assert not dict(app.query_params)


@pytest.mark.parametrize("text", ["May", "1815-06-18", "2200-01-01"])
def test_what_is_no_day_in_the_address_is_a_sentence(predicted: Store, text: str) -> None:
    app = home(until=text)
    assert plain(app)[1] == [f"'{text}' in the address is no day since 1950; write until=2026-03-31"]
    assert len(listed(app)) == 6


def test_whoever_comes_back_finds_the_filters_as_they_were(predicted: Store) -> None:
    app = home(find="M+F")
    app._page_hash = calc_hash("mixtures")
    app.query_params.clear()
    ran(app)
    app._page_hash = calc_hash(HOME)
    app.query_params.clear()
    app.query_params["mixture"] = "1"
    ran(app)
    assert listed(app) == [MF] * 2
    assert dict(app.query_params) == {"find": "M+F"}


def event(*customdata: list[int], **drawn: list[dict[str, list[float]]]) -> dict[str, Any]:
    points = [{"customdata": one, "curve_number": 3, "x": 0.6, "y": 0.6} for one in customdata]
    return {"selection": {"points": [*points, {"x": 0.6, "y": 0.6}], "box": [], "lasso": []} | drawn}


def test_one_click_is_told_from_a_box_and_a_lasso() -> None:
    assert picked(event([7])) == Picked((7,), (), True)
    assert picked(event([130, 125, 1])) == Picked((), ((130, 125, 1),), True)
    assert picked(event([7], box=[{"x": [0.5, 0.7], "y": [0.5, 0.7]}])) == Picked((7,), (), False)
    assert picked(event([7], [130, 125, 1], [7], lasso=[{"x": [0.5], "y": [0.7]}])) == Picked(
        (7,), ((130, 125, 1),), False
    )
    assert picked(event()) == picked({}) == Picked()


def test_a_click_on_a_point_opens_its_mixture(predicted: Store) -> None:
    app = home()
    (prediction,) = drawn(app)[0]["customdata"][1]
    app.session_state[PICKED] = Filters(), picked(event([prediction]))
    ran(app)
    assert app.title[0].value == "Mixtures"
    assert app.selectbox(key="mixture").value == 2
    assert PICKED not in app.session_state


def test_several_are_listed_until_the_filters_change(predicted: Store) -> None:
    app = home()
    ids = [one[0] for one in drawn(app)[0]["customdata"][:2]]
    app.session_state[PICKED] = Filters(), Picked(tuple(ids))
    ran(app)
    assert [heading.value for heading in app.subheader] == ["Methods", "2 picked"]
    assert listed(app) == [LF, LM]
    assert [series["selectedpoints"] for series in drawn(app)] == [[0, 1], []]
    ran(app.text_input(key="find").set_value("M+F"))
    assert listed(app) == [MF] * 2
    ran(app.text_input(key="find").set_value(""))
    ran(app.button(key="unpick").click())
    assert len(listed(app)) == 6


def test_a_cell_with_one_prediction_opens_it_and_one_with_more_lists_them(
    predicted: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    room = __import__("sys").modules[experiments.parity.__module__]
    monkeypatch.setattr(room, "MOST_POINTS", 1)
    app = home(method="graded")
    (squares,) = drawn(app)
    assert len(squares["customdata"]) == 3
    asked = Filters(methods=("graded",))
    app.session_state[PICKED] = asked, Picked(cells=tuple(map(tuple, squares["customdata"][:2])))
    ran(app)
    assert any("6 predictions" in caption.value or "3 predictions" in caption.value for caption in app.caption)
    assert (len(listed(app)), len(drawn(app))) == (2, 2)
    app.session_state[PICKED] = asked, picked(event(squares["customdata"][0]))
    ran(app)
    assert app.title[0].value == "Mixtures"


def test_a_marked_row_opens_its_mixture(predicted: Store) -> None:
    app = home()
    app.session_state[OPENED] = 2
    ran(app)
    assert (app.title[0].value, app.selectbox(key="mixture").value) == ("Mixtures", 2)


def test_the_row_that_is_marked_is_that_of_the_list_as_it_was_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    state: dict[str, Any] = {}
    monkeypatch.setattr(picking.st, "session_state", state)
    picking.show_rows([5, 3, 9])
    picking.open_row({"selection": {"rows": []}})
    assert picking.opened() is None
    picking.open_row({"selection": {"rows": [1]}})
    assert (picking.opened(), picking.opened()) == (3, None)


def test_few_messages_are_told_one_by_one_and_many_are_counted(pebbles: Store, tmp_path: Path) -> None:
    (tmp_path / "packing_tests.csv").write_text("material,compaction,packing_density\npebbles L,loose,0.47\n")
    experiments.register(pebbles, read_path(tmp_path / "packing_tests.csv"))
    experiments.predict(pebbles, FormulaRunner(pebbles))
    app = home()
    assert [text.value.split(":")[0].replace("\\", "") for text in app.warning] == ["pebbles L+F 1", "pebbles L+M 1"]
    said = "Predictions: 2 failed. The list tells why; choose a state above to see these alone."
    assert said in [text.value for text in app.markdown]
    experiments.predict(pebbles, FormulaRunner(pebbles), way=Way("graded"))
    app = home()
    assert not app.warning
    assert any(text.value.startswith("Predictions: 4 failed.") for text in app.markdown)
    assert frame_of(app, SAID)[SAID].str.contains("out of reach|pebbles L").sum() == 4


def test_outdated_predictions_are_hollow_and_said_to_be_left_out(predicted: Store, tmp_path: Path) -> None:
    (tmp_path / "packing_tests.csv").write_text("material,compaction,packing_density\npebbles F,loose,0.6\n")
    experiments.register(predicted, read_path(tmp_path / "packing_tests.csv"))
    app = home(method="graded")
    assert [(series["name"], series["marker"]["symbol"]) for series in drawn(app)] == [
        ("graded", "circle"), ("graded, outdated", "circle-open"),
    ]  # fmt: skip
    assert any("2 outdated (hollow or small, left out of the figures)" in text.value for text in app.markdown)
    assert list(frame_of(app, "mixtures compared")["mixtures compared"]) == ["1 of 3 measured"] * 2


def test_names_are_shown_as_they_stand(lab: Store, tmp_path: Path) -> None:
    for name, text in {
        "aggregates": "name\n*A*\nB\n",
        "sieves": "aggregate,aperture_mm,retained_percent\n*A*,8,0\n*A*,4,100\nB,4,0\nB,2,100\n",
        "packing_tests": "material,compaction,packing_density\n*A*,loose,0.58\nB,loose,0.6\n:red[M] <b>,loose,0.62\n",
        "mixtures": "mixture,aggregate,solid_volume_share\n:red[M] <b>,*A*,0.5\n:red[M] <b>,B,0.5\n",
    }.items():  # fmt: skip
        (tmp_path / f"{name}.csv").write_text(text)
    experiments.register(lab, read_path(tmp_path))
    assert [link.proto.label for link in home().get("page_link")] == ["\\:red\\[M\\] \\<b\\>"]
    experiments.predict(lab, FormulaRunner(lab))
    assert drawn(home())[0]["text"][0].startswith(":red[M] &lt;b><br>")


def test_every_filter_has_its_place_in_the_address(predicted: Store) -> None:
    app = home()
    keys = {one.key for kind in (app.text_input, app.multiselect, app.date_input) for one in kind}
    assert keys == filters.EMPTY.keys()


def test_what_nobody_has_changed_is_not_read_again_and_what_somebody_has_is(
    predicted: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    read, service = list[Filters](), experiments.parity
    monkeypatch.setattr(
        experiments, "parity", lambda target, asked, *rest: read.append(asked) or service(target, asked, *rest)
    )
    first, second = home(), home()
    ran(first)
    assert len(read) == 1
    assert listed(first) == listed(second)
    ran(second.text_input(key="find").set_value("M+F"))
    assert len(read) == 2
    experiments.predict(predicted, FormulaRunner(predicted), [LM], Way("monosized_rolling"))
    assert len(listed(ran(first))) == len(listed(home())) == 7
    assert len(read) == 3
