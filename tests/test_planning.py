"""What runs will cost: laws of the estimate, against the engine's own times and against runs made up by a formula."""

import datetime as dt
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import sqlalchemy as sa
from hypothesis import given
from hypothesis import strategies as st

from pdlab import packing, planning
from pdlab.experiments import known_runs
from pdlab.models import Run
from pdlab.planning import Ran, asked_steps, estimate, makespan
from pdlab.specimen import (
    LOOSE,
    REPOSE,
    RODDED,
    VIBRATED,
    Component,
    Protocol,
    Specimen,
    equal_spheres,
    heap_spheres,
    in_cylinder,
    mixed_spheres,
    with_seeds,
)
from pdlab.store import Store

BINARY = [Component(3.5, 0.2, 0.6, 2600.0), Component(1.0, 0.3, 0.4, 3400.0)]
BEDS = {
    "equal": equal_spheres(0.3, 1),
    "rodded": equal_spheres(0.3, 1, RODDED),
    "vibrated": equal_spheres(0.3, 1, replace(VIBRATED, shake_amplitude=0.3, shake_periods=50)),
    "binary": mixed_spheres(BINARY, 1, replace(LOOSE, local_damping=0.3, steps_per_collision=20.0)),
    "light and coarse": mixed_spheres([Component(2.0, 0.2, 0.6, 1000.0), Component(1.0, 0.3, 0.4, 2600.0)], 1),
    "cylinder": in_cylinder(BINARY, 30.0, 40.0, 1, Protocol("rodded", "cylinder", nominal_overlap=0.001)),
    "heap": heap_spheres(0.3, 1, protocol=replace(REPOSE, lift_speed=0.1)),
}


@pytest.mark.parametrize("bed", BEDS.values(), ids=list(BEDS))
def test_the_steps_that_a_test_asks_for_are_the_engines_times_at_its_time_step(bed: Specimen) -> None:
    whole = packing.setup(bed)
    time = sum(stage.duration or 0.0 for stage in whole.stages) + whole.layers * whole.fall_time
    assert planning.asked_time(bed) == pytest.approx(time, rel=1e-9)
    undamped = whole.time_step * math.sqrt(1.0 - whole.zeta**2)
    assert asked_steps(bed) == pytest.approx(time / undamped, rel=1e-9)


JOBS = st.lists(st.floats(0.01, 100.0), min_size=1, max_size=40)


@given(JOBS, st.integers(1, 12))
def test_no_worker_waits_while_a_job_does(jobs: list[float], workers: int) -> None:
    jobs = sorted(jobs, reverse=True)
    least = max([jobs[0], sum(jobs) / workers, *([jobs[workers - 1] + jobs[workers]] if len(jobs) > workers else [])])
    taken = makespan(jobs, workers)
    assert taken >= least * (1.0 - 1e-12)  # which no schedule beats
    assert taken <= sum(jobs) / workers + jobs[0] * (1.0 - 1.0 / workers) + 1e-9  # Graham, 1966
    assert makespan(jobs, 1) == pytest.approx(sum(jobs))
    assert makespan(jobs, len(jobs)) == jobs[0]


def made_up(bed: Specimen, draw: np.random.Generator, scatter: float = 0.1, speed: float = 5e6) -> Ran:
    """A run whose steps follow a formula, and its seconds a speed."""
    friction = min(kind.friction for kind in bed.species)
    steps = round(asked_steps(bed) * (1.5 + 3.0 * math.exp(-friction / 0.05)) * math.exp(scatter * draw.normal()))
    return Ran(bed, steps, bed.spheres * steps / speed)


def beds(frictions: tuple[float, ...], seeds: range) -> list[Specimen]:
    made = [equal_spheres(friction, 1) for friction in frictions]
    made += [mixed_spheres([Component(2.5, friction, 0.5), Component(1.0, friction, 0.5)], 1) for friction in frictions]
    return [one for bed in made for one in with_seeds(bed, seeds)]


def test_a_bed_costs_what_the_same_bed_cost_with_other_seeds() -> None:
    draw = np.random.default_rng(1)
    history = [made_up(bed, draw) for bed in beds((0.0, 0.1, 0.4), range(1, 9))]
    for bed in beds((0.0, 0.1, 0.4), range(20, 21)):
        alike = [run for run in history if replace(run.specimen, seed=0) == replace(bed, seed=0)]
        assert len(alike) == 8
        (steps,) = estimate([bed], history).steps
        assert steps == pytest.approx(np.median([run.steps for run in alike]), rel=0.1)


def test_nine_of_ten_jobs_take_what_their_range_says_and_the_ranges_are_no_wider_than_they_must() -> None:
    draw, inside, width = np.random.default_rng(2), [], []
    for _ in range(60):
        history = [made_up(bed, draw, 0.3) for bed in beds((0.0, 0.05, 0.1, 0.3, 1.0), range(1, 5))]
        new = beds((0.05, 0.3), range(10, 12))
        made = estimate(new, history)
        actual = sum(run.steps * run.specimen.spheres for run in (made_up(bed, draw, 0.3) for bed in new))
        inside.append(made.sphere_steps.low <= actual <= made.sphere_steps.high)
        width.append(made.sphere_steps.high / made.sphere_steps.low)
    assert 0.8 <= np.mean(inside) <= 1.0
    assert np.median(width) < 2.5


def test_a_store_without_runs_plans_by_what_is_built_in_and_says_that_the_speed_is_not_measured() -> None:
    made = estimate([run.specimen for run in planning.built_in()], [])
    assert made.steps == pytest.approx([run.steps for run in planning.built_in()], rel=0.1)
    assert not made.measured
    expected = made.seconds()
    assert expected.low < 0.7 * expected.value
    assert expected.high > 1.4 * expected.value


def test_one_timed_bed_tells_how_slow_the_machine_is_for_all() -> None:
    probe, far = planning.PROBE, [equal_spheres(0.1, 3, VIBRATED), mixed_spheres(BINARY, 4)]
    steps = round(estimate([probe], []).steps[0])
    usual = estimate(far, []).run_seconds
    slow = Ran(probe, steps, 3.0 * estimate([probe], []).run_seconds[0])
    made = estimate(far, [slow])
    assert made.measured
    assert made.run_seconds == pytest.approx(3.0 * usual, rel=0.05)
    assert made.load < estimate(far, []).load
    of_another = estimate(far, [replace(slow, seconds=None)])
    assert not of_another.measured
    assert of_another.run_seconds == pytest.approx(usual, rel=0.05)


def test_a_run_that_was_hindered_once_does_not_move_the_estimate_of_others() -> None:
    draw = np.random.default_rng(3)
    history = [made_up(bed, draw) for bed in beds((0.1, 0.4), range(1, 9))]
    new = beds((0.1, 0.4), range(20, 24))
    hindered = [replace(run, seconds=20.0 * (run.seconds or 0.0)) if k == 3 else run for k, run in enumerate(history)]
    before, after = (estimate(new, runs).run_seconds for runs in (history, hindered))
    assert after == pytest.approx(before, rel=0.05)


def test_workers_share_the_work_and_the_cores() -> None:
    made = estimate(with_seeds(equal_spheres(0.3, 1), range(1, 41)), [])
    alone = made.seconds(1).value
    assert made.seconds(4).value == pytest.approx(alone / 4.0, rel=0.1)
    assert made.seconds(4, cores=2).value == pytest.approx(alone / 2.0, rel=0.1)
    assert made.seconds(4, cores=8) == made.seconds(4)
    longest = made.seconds(400).value
    assert 1.0 <= longest / made.run_seconds.max() < 2.5


def test_equal_specimens_are_planned_once_and_none_cost_nothing() -> None:
    one = equal_spheres(0.3, 1)
    made = estimate([one, one, equal_spheres(0.3, 2)], [])
    assert (made.runs, made.spheres) == (2, 5000)
    none = estimate([], [])
    assert (none.runs, none.spheres, none.sphere_steps, none.seconds(3)) == (0, 0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def test_beds_by_geometry_alone_take_seconds_and_no_steps() -> None:
    placed = mixed_spheres(BINARY, 1, Protocol("drop_and_roll"))
    made = estimate([placed], [Ran(replace(placed, seed=2), 0, 5.0)])
    assert made.sphere_steps.value == 0.0
    assert made.run_seconds == pytest.approx([5.0], rel=0.01)


def test_what_it_took_stands_beside_the_estimate() -> None:
    bed = equal_spheres(0.3, 1)
    made = estimate([bed], [])
    took = made.seconds(2).value
    compared = planning.compare(made, [Ran(bed, 20_000, took)], took, workers=2)
    assert (compared.runs, compared.runs_taken, compared.sphere_steps_taken) == (1, 1, 5e7)
    assert compared.ratio == pytest.approx(1.0)
    assert compared.within
    assert not planning.compare(made, [], 10.0 * took, workers=2).within
    assert math.isnan(planning.compare(made, [], 0.0).ratio)


def test_the_store_tells_of_its_newest_runs_and_of_another_machines_steps_alone(
    store: Store, formula_runner: Any
) -> None:
    formula_runner(store)(with_seeds(equal_spheres(0.3, 1), range(1, 5)))
    assert known_runs(store) == []  # their effort was not kept
    days = [dt.datetime(2026, 1, seed, tzinfo=dt.UTC) for seed in (1, 2, 3)]
    with store.write() as session:
        for run in session.scalars(sa.select(Run).where(Run.seed < 4)):
            run.steps, run.seconds, run.finished_at = 20_000 + run.seed, 2.0 * run.seed, days[run.seed - 1]
            run.processor = "here" if run.seed < 3 else "there"
    found = known_runs(store, processor="here")
    assert [(run.specimen.seed, run.steps, run.seconds) for run in found] == [
        (3, 20_003, None), (2, 20_002, 4.0), (1, 20_001, 2.0)
    ]  # fmt: skip
    assert [run.seconds for run in known_runs(store)] == [6.0, 4.0, 2.0]
    assert known_runs(store, engine_version=10_000) == []
