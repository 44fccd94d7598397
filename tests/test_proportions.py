"""What stands beside a sweep: measured mixtures, theory, what is outdated; a wish for one; its figures."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from conftest import FormulaRunner
from surfaces import normal
from test_mixing import dense, ids

from pdlab import charts, experiments
from pdlab import store as the_store
from pdlab.charts.proportions import CORNERS, INSIDE, interval_corners, level_places, places, triangle_grid
from pdlab.dem import VERSION
from pdlab.errors import ShareError, UnknownName
from pdlab.experiments import Way, sweeps
from pdlab.models import Run, Sweep
from pdlab.specimen import Packing, Specimen
from pdlab.store import Store
from pdlab.surface import share_grid
from pdlab.sweep import MOST, WISHED_ERROR, Densest, NextTest, Point, Swept
from pdlab.tables import read_path

PEBBLES = ("pebbles L", "pebbles M", "pebbles F")
ENDS = PEBBLES[::2]
MORE = {
    "aggregates": "name\ngrit\n",
    "sieves": "aggregate,aperture_mm,passing_percent\ngrit,25,100\ngrit,20,0\n",
    "packing_tests": "material,compaction,packing_density\ngrit,loose,0.6\n",
}


def mixed(bed: Specimen) -> float:
    """A PD that rises where grains of several sizes are together, most where the coarse ones are more."""
    sizes, shares = np.array([one.diameter for one in bed.species]), np.array(bed.shares)
    gains = [
        0.4 * (1.0 - sizes[b] / sizes[a]) * shares[a] ** 1.3 * shares[b]
        for a in range(len(sizes)) for b in range(len(sizes)) if sizes[b] < sizes[a]
    ]  # fmt: skip
    return float(0.6 + sum(gains) + 0.001 * normal(bed.digest(3)))


class MixingRunner(FormulaRunner):
    """Beds of equal spheres as the formula has them, those of several sizes by ``mixed``."""

    def __call__(self, specimens: Sequence[Specimen]) -> list[Packing]:
        found = super().__call__(specimens)
        return [
            packing
            if len(bed.species) == 1
            else Packing(packing.digest, mixed(bed), 5.0, 20.0, bed.shares, 0.005, "still", 1000, 1.0, 3)
            for bed, packing in zip(specimens, found, strict=True)
        ]


def hill(aggregates: int, best: Sequence[float], digests: Sequence[str] = ()) -> Swept:
    """A sweep over the whole grid whose PD falls off around one mix, with a bed there."""
    shares = share_grid(aggregates)
    top = np.array(best)
    packing = 0.70 - 0.1 * np.sum((shares - top) ** 2, axis=1)
    mix = tuple(float(share) for share in best)
    low, high = (tuple(float(np.clip(share + by, 0, 1)) for share in best) for by in (-0.05, 0.05))
    densest = Densest(mix, low, high, 0.7, 0.0012, 0.004, 0.0015)
    following = NextTest(tuple([1.0 / aggregates] * aggregates), 0.68, 0.012, "it tells most")
    return Swept(
        tuple(f"a{k}" for k in range(aggregates)), tuple(Point(mix, 0.7, 0.002, one) for one in digests), shares,
        packing, np.full(len(shares), 0.003), densest, following, ("a note",),
    )  # fmt: skip


def keep(target: Store, names: Sequence[str], best: Sequence[float]) -> int:
    """Keep a sweep of calibrated aggregates as if its beds had shown a ``hill``; return its id."""
    runner = FormulaRunner(target)
    with target.read() as session:
        rows = the_store.aggregates(session, names)
    reports = {report.aggregate: report for report in experiments.calibrate(target, runner, names)}
    asked = sweeps._Asked(rows, Way(), WISHED_ERROR, MOST[len(rows)], VERSION, [reports[name] for name in names])
    sweeps._find_equal(target, asked)
    asked.result = hill(len(rows), best, runner.asked[:1])
    kept = sweeps._save(target, asked, None, None).sweep_id
    assert kept is not None
    return kept


def grit(target: Store, folder: Path) -> None:
    for name, text in MORE.items():
        (folder / f"{name}.csv").write_text(text, encoding="utf-8")
    experiments.register(target, read_path(folder))


def test_the_measured_points_are_the_newest_tests_of_the_sweep_s_compaction_of_mixtures_of_these_aggregates_alone(
    pebbles: Store, folder: Callable[..., Path]
) -> None:
    experiments.register_mixture(pebbles, "not tested", ids(pebbles, *ENDS), [0.3, 0.7], by_mass=False)
    experiments.register_mixture(pebbles, "three", ids(pebbles, *PEBBLES), [0.2, 0.3, 0.5], by_mass=False)
    experiments.register_mixture(pebbles, "rodded", ids(pebbles, *ENDS), [0.4, 0.6], by_mass=False)
    tests = "three,loose,0.66\nrodded,rodded,0.67\npebbles L+F 1:1,loose,0.651\n"
    tests += "pebbles L+F 1:1,rodded,0.68\n"
    experiments.register(pebbles, read_path(folder(packing_tests="material,compaction,packing_density\n" + tests)))
    known = experiments.proportions(pebbles, keep(pebbles, ENDS[::-1], (0.4, 0.6)))
    assert [(mix.name, mix.shares, mix.packing_density) for mix in known.measured] == [
        ("pebbles L+F 1:1", (0.5, 0.5), 0.651)
    ]
    assert known.measured[0].standard_error > 0.0
    assert [(mix.name, mix.shares) for mix in known.alone] == [("pebbles F", (1.0, 0.0)), ("pebbles L", (0.0, 1.0))]
    three = experiments.proportions(pebbles, keep(pebbles, PEBBLES, (0.5, 0.1, 0.4)))
    assert {mix.name: mix.shares for mix in three.measured} == {
        "pebbles L+M 1:1": (0.5, 0.5, 0.0), "pebbles L+F 1:1": (0.5, 0.0, 0.5), "pebbles M+F 1:1": (0.0, 0.5, 0.5),
        "three": (0.2, 0.3, 0.5),
    }  # fmt: skip


def test_theory_along_a_sweep_is_what_theory_says_of_its_mixtures(pebbles: Store) -> None:
    known = experiments.proportions(pebbles, keep(pebbles, ENDS, (0.65, 0.35)))
    assert known.result is not None
    (beside,) = experiments.by_theory(pebbles, ["pebbles L+F 1:1"])
    half = int(np.flatnonzero(known.result.shares[:, 0] == 0.5)[0])
    assert set(known.theories) == {"toufar", "cpm"}
    assert {name: values[half] for name, values in known.theories.items()} == pytest.approx(
        {name: beside.values[name] for name in known.theories}
    )
    assert not experiments.proportions(pebbles, keep(pebbles, PEBBLES, (0.5, 0.1, 0.4))).theories


def test_shares_by_mass_are_there_where_all_particle_densities_are_known(pebbles: Store, tmp_path: Path) -> None:
    kept = keep(pebbles, ENDS, (0.5, 0.5))
    assert experiments.proportions(pebbles, kept).mass_shares == (None, None)
    dense(pebbles, tmp_path)
    assert experiments.proportions(pebbles, kept).mass_shares[0] == pytest.approx((0.6, 0.4))


def test_a_sweep_is_outdated_by_another_test_of_an_aggregate_a_newer_engine_or_another_measured_mixture(
    pebbles: Store, folder: Callable[..., Path]
) -> None:
    kept = keep(pebbles, ENDS, (0.65, 0.35))
    assert experiments.proportions(pebbles, kept).outdated == ()
    experiments.register_mixture(pebbles, "later", ids(pebbles, *ENDS), [0.7, 0.3], by_mass=False)
    tests = "material,compaction,packing_density\nlater,loose,0.66\n"
    experiments.register(pebbles, read_path(folder(packing_tests=tests)))
    (one,) = experiments.proportions(pebbles, kept).outdated
    assert "measured since" in one
    experiments.register(pebbles, read_path(folder(packing_tests=tests.replace("later", "pebbles F"))))
    with pebbles.write() as session:
        facts = {"seed": 1, "spheres": 5, "state": "done", "packing_density": 0.6}
        session.add(Run(specimen_hash="f" * 64, specimen="{}", engine_version=VERSION + 1, **facts))
    said = experiments.proportions(pebbles, kept).outdated
    assert [text.split(":")[0].split(",")[0] for text in said] == [
        "pebbles F", f"by an older engine (version {VERSION})", "mixtures of these aggregates were measured since",
    ]  # fmt: skip
    assert all("sweep again" in text for text in said)


def test_a_sweep_is_wished_for_once_cancelled_asked_for_again_and_read_when_it_is_there(pebbles: Store) -> None:
    asked = ids(pebbles, *ENDS)
    wish = experiments.ask_proportions(pebbles, asked, "monosized")
    assert experiments.ask_proportions(pebbles, asked, "monosized") == wish
    waiting = experiments.waiting_sweep(pebbles, wish)
    assert waiting is not None
    assert (waiting.key, waiting.method, waiting.state) == (("sweep", wish), "monosized", "queued")
    assert experiments.proportions(pebbles, wish).result is None
    experiments.cancel(pebbles, [waiting.key])
    assert experiments.waiting_sweep(pebbles, wish) is None
    assert experiments.proportions(pebbles, wish).message == "cancelled"
    assert experiments.ask_proportions(pebbles, asked, "monosized") != wish
    kept = keep(pebbles, ENDS, (0.65, 0.35))
    assert experiments.ask_proportions(pebbles, asked, "monosized") == kept
    listed = experiments.newest_sweeps(pebbles, 2)
    assert (len(listed), listed[0].aggregates, listed[0].state) == (2, ENDS, "done")


def test_asking_leaves_it_to_the_runner_to_begin_a_sweep_which_takes_seconds(
    pebbles: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    experiments.calibrate(pebbles, FormulaRunner(pebbles), ENDS)
    monkeypatch.setattr(sweeps.sweep, "sweeping", lambda *_: pytest.fail("begun by the page"))
    wish = experiments.ask_proportions(pebbles, ids(pebbles, *ENDS), "monosized")
    assert experiments.waiting_sweep(pebbles, wish) is not None


def test_what_cannot_be_swept_is_said(pebbles: Store, folder: Callable[..., Path]) -> None:
    one, _, other = ids(pebbles, *PEBBLES)
    with pytest.raises(ShareError, match="2 to 5 aggregates, not 1"):
        experiments.ask_proportions(pebbles, [one, one], "auto")
    with pytest.raises(UnknownName, match="no aggregate 99"):
        experiments.ask_proportions(pebbles, [one, 99], "auto")
    with pytest.raises(UnknownName, match="no sweep 99"):
        experiments.proportions(pebbles, 99)
    assert experiments.waiting_sweep(pebbles, 99) is None
    loose = "material,compaction,packing_density\npebbles F,loose,0.3\n"
    experiments.register(pebbles, read_path(folder(packing_tests=loose)))
    experiments.calibrate(pebbles, FormulaRunner(pebbles), ENDS)
    failed = experiments.proportions(pebbles, experiments.ask_proportions(pebbles, [one, other], "monosized"))
    assert failed.state == "failed"
    assert failed.message.startswith("aggregate 'pebbles F' is not calibrated")


def drawn(aggregates: int, best: Sequence[float]) -> tuple[experiments.Proportions, Swept]:
    result = hill(aggregates, best, ["0" * 64])
    tested = experiments.MeasuredMix("<b>mine", (0.5, 0.5, *[0.0] * (aggregates - 2)), 0.66, 0.004)
    names = tuple(f"<i>aggregate {k}" for k in range(aggregates))
    known = experiments.Proportions(1, tuple(range(aggregates)), names, "auto", "done", result, measured=(tested,))
    return known, result


def test_the_iso_lines_grid_holds_the_corners_and_is_masked_outside_the_triangle() -> None:
    shares = share_grid(3)
    x, y, z = triangle_grid(shares, shares @ [0.6, 0.5, 0.4], rows=20)
    assert places(np.eye(3)).tolist() == CORNERS.tolist()
    across, up = np.meshgrid(x, y)
    top = up / CORNERS[0, 1]
    outside = (across < 0.5 * top - 1e-9) | (across > 1.0 - 0.5 * top + 1e-9)
    assert (np.isnan(z) == outside).all()
    assert (z[-1, 20], z[0, 0], z[0, -1]) == pytest.approx((0.6, 0.5, 0.4))
    right = across - 0.5 * top
    inside = ~outside
    assert z[inside] == pytest.approx((0.6 * top + 0.5 * (1.0 - top - right) + 0.4 * right)[inside]), "a plane is kept"


def test_a_line_of_equal_pd_is_labelled_on_it_off_the_sides_and_away_from_what_is_marked() -> None:
    shares = share_grid(3)
    plane = np.array([0.6, 0.5, 0.4])
    marked = places([[0.5, 0.2, 0.3], [0.2, 0.5, 0.3]])
    found = level_places([0.41, 0.45, 0.5, 0.55], triangle_grid(shares, shares @ plane), marked)
    assert list(found) == [0.45, 0.5, 0.55], "the line of 0.41 lies at a corner"
    for level, at in found.items():
        own = np.linalg.solve(np.vstack([CORNERS.T, np.ones(3)]), [*at, 1.0])
        assert own @ plane == pytest.approx(level)
        assert own.min() >= INSIDE - 1e-9
        assert np.linalg.norm(marked - at, axis=1).min() > 0.15


def test_the_triangle_marks_the_densest_mix_and_what_was_measured_at_their_shares() -> None:
    known, result = drawn(3, (0.6, 0.1, 0.3))
    figure = charts.proportion_triangle(known, result)
    marks = {trace.name: trace for trace in figure.data}
    for name, shares in (
        ("densest mix", (0.6, 0.1, 0.3)),
        ("measured", (0.5, 0.5, 0.0)),
        ("to test next", [1 / 3] * 3),
    ):
        assert (marks[name].x[0], marks[name].y[0]) == pytest.approx(tuple(places(shares)))
    assert "PD 0.7000 ± 0.0042" in marks["densest mix"].text[0]
    assert "&lt;b>mine" in marks["measured"].text[0]
    assert len(marks["proportions"].text) == len(result.shares), "each is told"
    assert marks["proportions"].marker.maxdisplayed == 1, "and none is drawn"
    assert "<i>" not in "".join(note.text for note in figure.layout.annotations) + "".join(marks["proportions"].text)
    around = np.stack([marks["densest mix, its interval"].x, marks["densest mix, its interval"].y], axis=1)
    assert (np.abs(around - places((0.6, 0.1, 0.3))).max(axis=0) > 0.02).all()


def test_the_polygon_around_the_densest_mix_has_its_corners_at_the_ends_of_the_intervals() -> None:
    best = Densest((0.6, 0.1, 0.3), (0.55, 0.05, 0.25), (0.65, 0.15, 0.35), 0.7, 0.001, 0.004, 0.001)
    corners = interval_corners(best)
    assert len(corners) == 7, "six corners, closed"
    assert corners.sum(axis=1) == pytest.approx(np.ones(7))
    ends = np.isclose(corners, best.low) | np.isclose(corners, best.high)
    assert (ends.sum(axis=1) >= 2).all()
    alone = Densest((0.0, 0.0, 1.0), (0.0, 0.0, 1.0), (0.0, 0.0, 1.0), 0.7, 0.001, 0.004, 0.001)
    assert np.unique(interval_corners(alone), axis=0).tolist() == [[0.0, 0.0, 1.0]]


def test_the_curve_of_two_has_mean_and_deviation_as_its_band_and_the_densest_mix_with_its_interval() -> None:
    known, result = drawn(2, (0.65, 0.35))
    figure = charts.share_curve(known, result)
    band, mean = figure.data[:2]
    many = len(result.shares)
    assert list(band.y[:many]) == pytest.approx(list(result.packing_density + result.deviation))
    assert list(band.y[many:][::-1]) == pytest.approx(list(result.packing_density - result.deviation))
    assert (list(mean.x), list(mean.y)) == (list(100.0 * result.shares[:, 0]), list(result.packing_density))
    marks = {trace.name: trace for trace in figure.data}
    best, tested = marks["densest mix"], marks["measured"]
    assert (best.x[0], best.y[0], best.error_y.array[0]) == pytest.approx((65.0, 0.7, np.hypot(0.0012, 0.004)))
    assert (best.error_x.array[0], best.error_x.arrayminus[0]) == pytest.approx((5.0, 5.0))
    assert (tested.x[0], tested.y[0], tested.error_y.array[0]) == (50.0, 0.66, 0.004)
    assert "<i>" not in figure.layout.xaxis.title.text


def test_a_profile_of_four_is_the_densest_mix_of_all_with_so_much_of_an_aggregate() -> None:
    known, result = drawn(4, (0.4, 0.3, 0.2, 0.1))
    lines = charts.share_profiles(known, result).data
    for k, best in enumerate((40.0, 30.0, 20.0, 10.0)):
        line, star = lines[2 * k : 2 * k + 2]
        assert len(line.x) == 21
        assert (star.x[0], star.y[0]) == (best, 0.7)
        assert line.x[int(np.argmax(line.y))] == pytest.approx(best)
        for x, y in zip(line.x, line.y, strict=True):
            assert y == max(result.packing_density[np.isclose(result.shares[:, k], x / 100.0)])


def test_a_sweep_s_row_without_its_curve_is_enough_for_the_list(pebbles: Store) -> None:
    keep(pebbles, ENDS, (0.65, 0.35))
    with pebbles.read() as session:
        (row,) = the_store.newest_sweeps(session, 5)
        assert isinstance(row, Sweep)
        assert "curve" not in row.__dict__
