"""Every method of a store beside its measured mixtures."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import select

from pdlab import Lab, theory
from pdlab.errors import InputError, UnknownName
from pdlab.experiments import Way, by_theory, comparisons, predict, register
from pdlab.experiments.comparing import CONSTANT, FITTED, Compared, MethodErrors, compare
from pdlab.experiments.theories import MODELS
from pdlab.lab import SHIPPED
from pdlab.models import Prediction, now
from pdlab.store import Store
from pdlab.tables import read_path

Folder = Callable[..., Path]
LM, LF, MF = "pebbles L+M 1:1", "pebbles L+F 1:1", "pebbles M+F 1:1"
REFERENCES = [CONSTANT, *MODELS, FITTED]


def of(several: tuple[MethodErrors, ...]) -> dict[str, MethodErrors]:
    return {one.method: one for one in several}


@pytest.fixture
def predicted(pebbles: Store, formula_runner: Any) -> Store:
    predict(pebbles, formula_runner(pebbles))
    return pebbles


def test_ferets_pebbles_by_every_method(predicted: Store) -> None:
    found = compare(predicted)
    assert list(found.outcomes) == ["monosized", *REFERENCES]
    assert found.common == (LM, LF, MF)
    errors = {one.method: one.errors.mean_absolute.value for one in found.over_common}
    known = {"toufar": 0.0106, "cpm": 0.0115, "furnas": 0.1085, "volume_mean": 0.0373}
    assert {name: errors[name] for name in known} == pytest.approx(known, abs=5e-5)
    assert errors[CONSTANT] == pytest.approx((0.0095 + 0.0125 + 0.022) / 3)
    differences = [report.difference for report in comparisons(predicted)]
    assert [found.difference("monosized", name) for name in found.measured] == differences
    assert errors["monosized"] == pytest.approx(sum(abs(value or 0.0) for value in differences) / 3)
    assert found.over_own == found.over_common
    assert found.measured_error == pytest.approx(0.005)


def test_the_gain_over_the_volume_mean_is_paired_and_negative_where_a_method_is_better(predicted: Store) -> None:
    found = of(compare(predicted).over_common)
    assert found["volume_mean"].gain is None
    for name in ("toufar", "furnas"):
        gain = found[name].gain
        assert gain is not None
        own, plain = (found[method].errors.mean_absolute.value for method in (name, "volume_mean"))
        assert gain.value == pytest.approx(own - plain)
        assert math.copysign(1.0, gain.low or 0.0) == math.copysign(1.0, gain.high or 0.0) == (-1, 1)[name == "furnas"]
    assert found["furnas"].worst == LM


def test_without_predictions_the_theories_stand_alone(pebbles: Store) -> None:
    assert list(compare(pebbles).outcomes) == REFERENCES


def test_what_is_fitted_to_two_mixtures_is_absent_and_says_why(predicted: Store) -> None:
    found = compare(predicted, [LM, LF])
    assert list(found.measured) == [LM, LF]
    ((reason, names),) = found.lacking(FITTED).items()
    assert "1 other mixtures depend on the compaction index K, it takes 2" in reason
    assert names == [LM, LF]
    assert FITTED not in of(found.over_own)
    assert found.common == (LM, LF)  # an absent method takes none from the others
    (alone,) = compare(predicted, [LM]).lacking(CONSTANT)
    assert "the mean of the others takes 2 measured mixtures" in alone


def test_what_is_fitted_leaves_the_mixture_itself_out(predicted: Store, folder: Folder) -> None:
    before = compare(predicted)
    tests = f"material,compaction,packing_density,date\n{LM},unstated,0.66,2026-02-03\n"
    register(predicted, read_path(folder(packing_tests=tests) / "packing_tests.csv"))
    after = compare(predicted)
    assert after.measured[LM] == 0.66
    for method in (CONSTANT, FITTED):
        assert after.outcomes[method][LM] == pytest.approx(before.outcomes[method][LM], abs=1e-12)
        assert after.outcomes[method][LF] != pytest.approx(before.outcomes[method][LF], abs=1e-4)


def test_methods_are_compared_on_the_mixtures_that_all_have_and_on_their_own(
    predicted: Store, formula_runner: Any
) -> None:
    predict(predicted, formula_runner(predicted), [LM, MF], Way("auto"))
    found = compare(predicted)
    assert list(found.outcomes)[:2] == ["monosized", "auto"]
    assert found.lacking("auto") == {"not predicted yet": [LF]}
    assert found.common == (LM, MF)
    assert {one.errors.mixtures for one in found.over_common} == {2}
    assert {one.method: one.errors.mixtures for one in found.over_own} == {
        "monosized": 3, "auto": 2, **dict.fromkeys(REFERENCES, 3),
    }  # fmt: skip


def test_outdated_and_failed_predictions_and_variants_do_not_count(predicted: Store, folder: Folder) -> None:
    with predicted.write() as session:
        row = session.scalars(select(Prediction).where(Prediction.mixture_id == 3)).one()
        other = {"mixture_id": 1, "protocol": "{}", "state": "done", "packing_density": 0.9, "method": "graded"}
        session.add(Prediction(variant="local_damping=0", **other))
        failed = {"state": "failed", "message": "a bed did not come to rest", "requested_at": now()}
        session.add(Prediction(mixture_id=row.mixture_id, method="monosized", protocol="{}", **failed))
    tests = "material,compaction,packing_density,date\npebbles L,unstated,0.61,2026-02-03\n"
    register(predicted, read_path(folder(packing_tests=tests) / "packing_tests.csv"))
    found = compare(predicted)
    assert "graded" not in found.outcomes
    reasons = {name: reason for reason, names in found.lacking("monosized").items() for name in names}
    assert reasons.keys() == {LM, LF, MF}
    assert reasons[LM].startswith("outdated: pebbles L: tested or sieved anew since")
    assert reasons[MF] == "failed: a bed did not come to rest"
    assert "monosized" not in of(found.over_common)
    assert found.common == (LM, LF, MF)


def test_a_mixture_rodded_of_aggregates_tested_loose_is_compared_by_cpm_only(predicted: Store, folder: Folder) -> None:
    tests = f"material,compaction,packing_density,date\n{LM},rodded,0.66,2026-02-03\n"
    register(predicted, read_path(folder(packing_tests=tests) / "packing_tests.csv"))
    found = compare(predicted)
    has = {method for method, values in found.outcomes.items() if not isinstance(values[LM], str)}
    assert has == {"cpm", CONSTANT}
    assert "monosized knows no compaction and cannot mix loose and rodded" in next(iter(found.lacking("monosized")))
    assert "the aggregates were tested loose, the mixture rodded" in " ".join(found.lacking(FITTED))
    assert found.common == (LF, MF)


def test_mixtures_without_a_measurement_are_left_out_and_named(predicted: Store, folder: Folder) -> None:
    more = "mixture,aggregate,solid_volume_share\nnew,pebbles L,0.5\nnew,pebbles F,0.5\n"
    register(predicted, read_path(folder(mixtures=more) / "mixtures.csv"))
    found = compare(predicted)
    assert found.unmeasured == ("new",)
    assert "new" not in found.measured
    with pytest.raises(InputError, match="none of these mixtures has a density test"):
        compare(predicted, ["new"])
    with pytest.raises(UnknownName):
        compare(predicted, ["nothing"])


def test_the_theories_are_those_of_the_rule(predicted: Store, folder: Folder) -> None:
    sieves = "aggregate,aperture_mm,passing_percent,date\npebbles F,20.32,100,2026-02-03\n"
    sieves += "pebbles F,14,50,2026-02-03\npebbles F,1,0,2026-02-03\n"
    register(predicted, read_path(folder(sieves=sieves) / "sieves.csv"))
    usual, harmonic = compare(predicted), compare(predicted, rule="harmonic")
    wanted = {one.mixture: one.values["toufar"] for one in by_theory(predicted, rule="harmonic")}
    assert harmonic.outcomes["toufar"] == wanted != usual.outcomes["toufar"]


def test_the_fitted_index_is_that_of_each_compaction_alone(store: Store, folder: Folder) -> None:
    sieves = "aggregate,aperture_mm,passing_percent\n"
    sieves += "".join(f"{name},{2 * size},100\n{name},{size},0\n" for name, size in (("A", 16), ("B", 4), ("C", 1)))
    sieves += "".join(f"{name}r,{2 * size},100\n{name}r,{size},0\n" for name, size in (("A", 16), ("B", 4), ("C", 1)))
    tests, mixtures = "material,compaction,packing_density\n", "mixture,aggregate,solid_volume_share\n"
    for way, ending, index, alone in (("loose", "", 5.0, 0.56), ("rodded", "r", 8.0, 0.6)):
        parts = [theory.Material(size * 2**0.5, alone) for size in (16, 4, 1)]
        for pair in ((0, 1), (0, 2), (1, 2)):
            shares = [0.6 if k == pair[0] else 0.4 if k == pair[1] else 0.0 for k in range(3)]
            names = [f"{'ABC'[k]}{ending}" for k in pair]
            value = theory.cpm(parts, [shares], index)[0]
            tests += f"mixture:{'+'.join(names)},{way},{value}\n"
            mixtures += f"{'+'.join(names)},{names[0]},0.6\n{'+'.join(names)},{names[1]},0.4\n"
        tests += "".join(f"aggregate:{name}{ending},{way},{alone}\n" for name in "ABC")
    aggregates = "name\n" + "".join(f"{name}\n{name}r\n" for name in "ABC")
    register(store, read_path(folder(aggregates=aggregates, sieves=sieves, packing_tests=tests, mixtures=mixtures)))
    found: Compared = compare(store)
    assert found.index == pytest.approx((5.0, 8.0), rel=1e-4)
    assert of(found.over_own)[FITTED].errors.mean_absolute.value < 1e-5
    assert of(found.over_own)["cpm"].errors.mean_absolute.value > 1e-3


def test_lab_compares_as_a_frame_with_intervals_of_the_seed(tmp_path: Path) -> None:
    with Lab(tmp_path / "lab.db") as lab:
        lab.import_tables(SHIPPED)
        frame = lab.compare()
        toufar = frame[(frame["method"] == "toufar") & (frame["over"] == "common")].iloc[0]
        assert toufar["mixtures"] == 3
        assert toufar["mean_absolute_error_low"] < toufar["mean_absolute_error"] < toufar["mean_absolute_error_high"]
        assert abs(toufar["largest_error"]) == pytest.approx(0.0140, abs=5e-5)
        assert toufar["largest_mixture"] == LF
        assert set(frame["over"]) == {"common", "own"}
        assert frame.equals(lab.compare())
        narrower = lab.compare(confidence=0.5).iloc[0]
        assert narrower["bias_high"] - narrower["bias_low"] < frame.iloc[0]["bias_high"] - frame.iloc[0]["bias_low"]
        with pytest.raises(InputError, match="must lie between 0 and 1"):
            lab.compare(confidence=95)
