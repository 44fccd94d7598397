"""The report on the page: offered where a result is shown, made only when it is asked for, what is wrong a sentence."""

from collections.abc import Callable
from typing import Any

import pytest
from conftest import FormulaRunner
from test_explaining import view as calibration_view
from test_mixing import ids
from test_page import lab
from test_page_mixtures import EQUAL, mixture, ran, stocked
from test_page_mixtures import view as mixture_view

from pdlab import experiments, report
from pdlab.experiments import Way
from pdlab.page import lab_report
from pdlab.store import Store

__all__ = ["lab", "stocked"]


@pytest.fixture
def offered(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Callable[[], str], str]]:
    """What the page offers to download: what makes it, and the file's name."""
    out = list[tuple[Callable[[], str], str]]()

    def button(label: str, data: Callable[[], str], file_name: str, mime: str, **more: Any) -> None:
        assert (label, mime) == ("Download the report", "text/html")
        out.append((data, file_name))

    monkeypatch.setattr(lab_report.st, "download_button", button)
    return out


def test_a_view_offers_a_report_that_is_not_made_before_it_is_asked_for(
    stocked: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    experiments.predict(stocked, FormulaRunner(stocked), [EQUAL])
    asked = list[str]()
    monkeypatch.setattr(report, "mixture", lambda *_: asked.append("mixture"))
    monkeypatch.setattr(report, "aggregate", lambda *_: asked.append("aggregate"))
    for app in (mixture_view(mixture(stocked)), calibration_view(ids(stocked, "pebbles F")[0])):
        (button,) = app.get("download_button")
        assert button.label == "Download the report"
        assert button.proto.deferred_file_id
    assert asked == []


def test_the_report_of_a_mixture_is_by_the_method_that_is_shown(
    stocked: Store, offered: list[tuple[Callable[[], str], str]]
) -> None:
    app = mixture_view(mixture(stocked))
    assert "not predicted yet" in offered[-1][0]()
    for method in ("monosized", "graded"):
        experiments.predict(stocked, FormulaRunner(stocked), [EQUAL], Way(method))
    ran(app)
    for method in ("monosized", "graded"):
        ran(app.radio(key=f"method_{EQUAL}").set_value(method))
        make, name = offered[-1]
        assert f"Predicted by the method {method}, finished" in make()
        assert name == "report-pebbles-L+F-1-1.html"


def test_the_report_of_an_aggregate_is_its_calibration(
    stocked: Store, offered: list[tuple[Callable[[], str], str]]
) -> None:
    calibration_view(ids(stocked, "pebbles F")[0])
    make, name = offered[-1]
    assert name == "report-pebbles-F.html"
    assert "<h1>Aggregate pebbles F</h1>" in make()


def test_a_report_of_what_is_gone_meanwhile_is_a_sentence(
    stocked: Store, offered: list[tuple[Callable[[], str], str]]
) -> None:
    key = mixture(stocked)
    mixture_view(key)
    assert experiments.delete(stocked, "packing_test:5", "me", None, True)
    assert experiments.delete(stocked, f"mixture:{EQUAL}", "me", None, True)
    assert f"<p>the store holds no mixture {key}; choose another</p>" in offered[-1][0]()
