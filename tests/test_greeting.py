"""An empty store greets on every view: what pdlab does, the first steps as they get done, an example by one button."""

import pytest
from conftest import FormulaPool, FormulaRunner
from streamlit.testing.v1 import AppTest
from streamlit.util import calc_hash
from test_page import PAGE, lab

from pdlab import experiments
from pdlab.batch.runner import Runner
from pdlab.batch.working import answer
from pdlab.experiments import SHIPPED, FirstSteps
from pdlab.page.app import HOME
from pdlab.page.greeting import STEPS
from pdlab.store import Store
from pdlab.tables import read_path

__all__ = ["lab"]


def view(address: str) -> AppTest:
    app = AppTest.from_file(str(PAGE), default_timeout=60)
    app._page_hash = calc_hash(address)
    app.run()
    assert not app.exception
    return app


def steps(app: AppTest) -> list[str]:
    return [str(link.proto.label).replace("\\", "") for link in app.get("page_link")]


@pytest.mark.parametrize(
    ("address", "lacking"),
    [
        (HOME, "The store holds no mixture yet."),
        ("aggregates", "The store holds no aggregate yet."),
        ("calibration", "The store holds no aggregate yet."),
        ("mixtures", "A mixture takes two aggregates or more."),
    ],
)
def test_an_empty_store_greets_with_the_first_steps_and_the_example(lab: Store, address: str, lacking: str) -> None:
    app = view(address)
    assert lacking in [info.value.replace("\\", "") for info in app.info]
    assert steps(app)[-4:] == [words for words, _ in STEPS]
    assert app.button(key="example")


def test_steps_are_done_one_after_another(lab: Store) -> None:
    assert experiments.first_steps(lab) == FirstSteps(False, False, False, False)
    experiments.register(lab, read_path(SHIPPED / "aggregates.csv"))
    assert experiments.first_steps(lab) == FirstSteps(True, False, False, False)
    app = view(HOME)
    assert steps(app)[-4:] == [f"{STEPS[0][0]} (done)", *(words for words, _ in STEPS[1:])]
    assert not [button for button in app.button if button.key == "example"], "the store is not empty"
    experiments.register(lab, read_path(SHIPPED))
    experiments.calibrate(lab, FormulaRunner(lab), ["pebbles L"])
    assert experiments.first_steps(lab) == FirstSteps(True, True, True, False)
    experiments.predict(lab, FormulaRunner(lab))
    assert experiments.first_steps(lab) == FirstSteps(True, True, True, True)


@pytest.mark.parametrize("address", [HOME, "mixtures"])
def test_the_example_is_loaded_and_its_predictions_are_worked_out_by_the_runner(lab: Store, address: str) -> None:
    app = view(address)
    app.button(key="example").click().run()
    assert not app.exception
    names = experiments.mixture_names(lab, 10)
    assert len(names) == 3
    waiting = [experiments.waiting_prediction(lab, key) for key in names]
    runner = Runner(lab, FormulaPool())
    list(answer(runner, [one.key for one in waiting if one is not None]))
    runner.close()
    assert {report.state for report in experiments.comparisons(lab)} == {"done"}
    assert all(report.difference is not None for report in experiments.comparisons(lab))


def test_the_example_opens_its_first_mixture_with_the_wish_that_waits(lab: Store) -> None:
    app = view("mixtures")
    app.button(key="example").click().run()
    assert app.selectbox(key="mixture").value in experiments.mixture_names(lab, 10)
    assert app.button(key="cancel")
    assert "loaded: the example; 3 predictions are asked for" in [one.value.replace("\\", "") for one in app.success]
