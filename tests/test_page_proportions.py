"""The view of proportions by AppTest: asked for, watched, cancelled, failed, come back to, read, put together."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import FormulaPool, FormulaRunner
from streamlit.testing.v1 import AppTest
from streamlit.util import calc_hash
from test_mixing import dense, ids
from test_page import PAGE, lab
from test_page_mixtures import charted, metrics, ran, said, stocked
from test_proportions import ENDS, PEBBLES, grit, keep

from pdlab import experiments
from pdlab.batch.runner import Runner
from pdlab.batch.working import answer
from pdlab.store import Store
from pdlab.tables import read_path

__all__ = ["lab", "stocked"]


def view(**asked: object) -> AppTest:
    app = AppTest.from_file(str(PAGE), default_timeout=60)
    app._page_hash = calc_hash("proportions")
    for name, value in asked.items():
        app.query_params[name] = str(value)
    return ran(app)


def errors(app: AppTest) -> list[str]:
    return [error.value.replace("\\", "") for error in app.error]


def address(app: AppTest, name: str) -> str:
    found = app.query_params.get(name, "")
    return found[0] if isinstance(found, list) else found


def has(app: AppTest, key: str) -> bool:
    return any(button.key == key for button in app.button)


def mixes(app: AppTest) -> dict[str, dict[str, str]]:
    (table,) = [block.value for block in app.table if "its interval [%]" in block.value]
    return {name: dict(table[name]) for name in table}


def test_without_two_aggregates_there_is_nothing_to_sweep(lab: Store) -> None:
    assert any("A sweep takes two aggregates or more" in text for text in said(view()))
    assert any("A sweep takes two aggregates or more" in text for text in said(view(aggregates="1,2")))


def test_one_aggregate_is_asked_to_be_more_and_what_is_no_address_is_passed_over(stocked: Store) -> None:
    for wrong in ("1,", "x", "1" * 30):
        app = view(aggregates=wrong)
        assert app.multiselect(key="swept_parts").value == []
        assert any("Choose two to five aggregates" in text for text in said(app))
    assert not has(app, "ask")
    assert any("no sweep 99" in text for text in errors(view(sweep=99)))


def test_a_sweep_is_asked_for_watched_left_come_back_to_cancelled_and_asked_for_again(stocked: Store) -> None:
    one, other = ids(stocked, *ENDS)
    app = view(aggregates=f"{one},{other}")
    assert app.multiselect(key="swept_parts").value == [one, other]
    assert app.selectbox(key="way").value == "auto"
    ran(app.button(key="ask").click())
    wish = int(address(app, "sweep"))
    assert address(app, "aggregates") == ""
    app = view(sweep=wish)
    (bar,) = app.get("progress")
    assert bar.proto.text.replace("\\", "").startswith("auto, 1st in line")
    ran(app.button(key="cancel").click())
    assert experiments.waiting_sweep(stocked, wish) is None
    assert "cancelled" in said(app)
    ran(app.button(key="again").click())
    assert int(address(app, "sweep")) != wish
    assert has(app, "cancel")
    assert len(app.selectbox(key="sweep").options) == 3


def test_a_runner_answers_the_wish_and_the_curve_of_two_is_drawn(stocked: Store, tmp_path: Path) -> None:
    dense(stocked, tmp_path)
    one, other = ids(stocked, *ENDS)
    app = view(aggregates=f"{one},{other}")
    ran(app.selectbox(key="way").set_value("monosized"))
    ran(app.button(key="ask").click())
    runner = Runner(stocked, FormulaPool())
    list(answer(runner, [("sweep", int(address(app, "sweep")))]))
    runner.close()
    app = view(sweep=address(app, "sweep"))
    known = experiments.proportions(stocked, int(address(app, "sweep"))).result
    assert known is not None
    assert known.next_test is not None
    best = known.densest
    assert [(metric.label.replace("\\", ""), metric.value, metric.delta) for metric in app.metric] == [
        ("Densest mix, PD", f"{best.packing_density:.4f}", f"± {best.standard_error:.4f}"),
        ("± inputs", f"{best.input_error:.4f}", ""),
        ("To gain, at most", f"{best.to_gain:.4f}", ""),
        ("To test next, PD", f"{known.next_test.packing_density:.4f}", f"± {known.next_test.error:.4f}"),
    ]
    table = mixes(app)
    assert table["densest mix, by solid volume [%]"]["pebbles L"] == f"{100 * best.shares[0]:.4g}"
    assert table["its interval [%]"]["pebbles L"] == f"{100 * best.low[0]:.3g} to {100 * best.high[0]:.3g}"
    assert {"by mass [%]", "test next, by mass [%]"} < set(table)
    assert charted(app) == 1
    assert any("errors" in text and "too small" in text for text in said(app)), "what docs/sweep.md says of them"
    assert any(known.next_test.why in text for text in said(app))


@pytest.mark.parametrize(
    ("names", "best"), [(PEBBLES, (0.6, 0.1, 0.3)), ((*PEBBLES, "grit"), (0.4, 0.3, 0.2, 0.1))], ids=["three", "four"]
)
def test_three_are_a_triangle_and_four_are_profiles(
    stocked: Store, tmp_path: Path, names: tuple[str, ...], best: tuple[float, ...]
) -> None:
    grit(stocked, tmp_path)
    app = view(sweep=keep(stocked, names, best))
    assert metrics(app)["Densest mix, PD"] == "0.7000"
    assert list(mixes(app)["densest mix, by solid volume [%]"].values()) == [f"{100 * share:.4g}" for share in best]
    (chart,) = app.get("plotly_chart")
    kinds = {trace["type"] for trace in json.loads(chart.proto.spec)["data"]}
    assert ("contour" in kinds) == (len(names) == 3)
    assert any("the densest that can be had with so much of it" in text for text in said(app)) == (len(names) == 4)
    assert "a note" in said(app)


@pytest.mark.parametrize(
    ("key", "names", "shares"),
    [("densest", ["pebbles L", "pebbles F"], ["62.5"]), ("next", [*PEBBLES], ["33.3333", "33.3333"])],
)
def test_a_mix_is_put_together_with_its_shares_without_those_that_have_none(
    stocked: Store, key: str, names: list[str], shares: list[str]
) -> None:
    app = view(sweep=keep(stocked, PEBBLES, (0.625, 0.0, 0.375)))
    ran(app.button(key=f"together_{key}").click())
    assert app.title[0].value == "Mixtures"
    assert app.selectbox(key="mixture").value == 0
    assert app.multiselect(key="parts").value == ids(stocked, *names)
    assert [box.value for box in app.text_input if (box.key or "").startswith("share_")] == shares
    rest = 100.0 - sum(map(float, shares))
    assert metrics(app) == {f"{names[-1]}: the rest [%]": f"{rest:.4g}"}
    app._page_hash = calc_hash("mixtures")  # to which a browser has gone by now
    app.text_input(key="mixture_name").set_value("densest")
    ran(app.button(key="save").click())
    made = next(key for key, name in experiments.mixture_names(stocked, 1).items() if name == "densest")
    assert app.selectbox(key="mixture").value == made


def test_one_aggregate_alone_is_nothing_to_put_together(stocked: Store) -> None:
    app = view(sweep=keep(stocked, ENDS, (1.0, 0.0)))
    assert not has(app, "together_densest")
    assert has(app, "together_next")
    assert any("one aggregate alone" in text for text in said(app))


def test_a_failed_sweep_says_why(stocked: Store, folder: Callable[..., Path]) -> None:
    loose = "material,compaction,packing_density\npebbles F,loose,0.3\n"
    experiments.register(stocked, read_path(folder(packing_tests=loose)))
    failed = experiments.sweep_aggregates(stocked, FormulaRunner(stocked), ENDS).sweep_id
    app = view(sweep=failed)
    assert any(text.startswith("aggregate 'pebbles F' is not calibrated") for text in said(app))
    assert charted(app) == 0
    ran(app.button(key="again").click())
    assert address(app, "sweep") == str(failed), "what fails again for the same reason is the same"


def test_an_outdated_sweep_says_so_and_is_asked_for_again(stocked: Store, folder: Callable[..., Path]) -> None:
    kept = keep(stocked, ENDS, (0.65, 0.35))
    assert not has(view(sweep=kept), "again")
    tests = "material,compaction,packing_density\npebbles F,loose,0.59\n"
    experiments.register(stocked, read_path(folder(packing_tests=tests)))
    app = view(sweep=kept)
    assert any("Outdated: pebbles F: tested or sieved anew since" in text for text in said(app))
    assert charted(app) == 1
    ran(app.button(key="again").click())
    assert address(app, "sweep") != str(kept)
    assert has(app, "cancel")
