"""A mixture is put together of shares that sum to one; its wish is watched; its bed is drawn by aggregate."""

import datetime as dt
import io
import math
from pathlib import Path

import numpy as np
import pytest
import sqlalchemy as sa
from conftest import FormulaRunner
from hypothesis import given
from hypothesis import strategies as st

from pdlab import density, experiments
from pdlab import store as store_module
from pdlab.errors import GradingError, InputError, TableError, UnknownName
from pdlab.experiments import Way, waiting
from pdlab.grading import Grading, SieveRow, SieveTable, combined, make_grading, passing_at
from pdlab.models import Calibration, Prediction, Run, RunState, now
from pdlab.specimen import from_canonical
from pdlab.store import Store
from pdlab.tables import read_path


def sieved(*rows: tuple[float | None, float]) -> Grading:
    return make_grading(SieveTable(tuple(SieveRow(*row) for row in rows), "retained_g"))


COARSE, FINE = sieved((16.0, 0.0), (8.0, 60.0), (4.0, 40.0)), sieved((4.0, 0.0), (1.0, 90.0), (None, 10.0))


def test_a_combined_grading_passes_the_mean_of_its_parts_by_solid_volume() -> None:
    mixed = combined([COARSE, FINE], [0.75, 0.25])
    assert mixed.apertures == (16.0, 8.0, 4.0, 1.0, 0.5)
    assert mixed.passing.tolist() == pytest.approx([1.0, 0.55, 0.25, 0.025, 0.0])
    assert mixed.sieves == 4, "the pan's lower size is no sieve"


def test_apertures_that_only_one_part_has_are_interpolated_in_the_other() -> None:
    wide, between = sieved((16.0, 0.0), (4.0, 100.0)), sieved((16.0, 0.0), (8.0, 100.0))
    mixed = combined([wide, between], [0.5, 0.5])
    assert dict(zip(mixed.apertures, mixed.passing, strict=True))[8.0] == pytest.approx(0.25)  # 8 is halfway in logs


@given(st.floats(0.01, 0.99))
def test_whatever_the_share_a_combined_grading_lies_between_its_parts_and_sums_to_one(share: float) -> None:
    mixed = combined([COARSE, FINE], [share, 1.0 - share])
    assert math.fsum(mixed.shares) == pytest.approx(1.0)
    assert min(mixed.shares) >= 0.0
    for aperture in mixed.apertures:
        ends = passing_at(COARSE, aperture), passing_at(FINE, aperture)
        assert min(ends) - 1e-12 <= passing_at(mixed, aperture) <= max(ends) + 1e-12


@pytest.mark.parametrize("shares", [(0.5,), (0.5, 0.6), (1.5, -0.5), (1.0, 0.0)])
def test_shares_that_are_none_give_no_combined_grading(shares: tuple[float, ...]) -> None:
    with pytest.raises(GradingError):
        combined([COARSE, FINE], shares)


def test_solids_and_voids_fill_a_cubic_metre_and_mass_shares_go_back_to_solid_volume() -> None:
    assert density.void_volume(0.6) == pytest.approx(400.0)
    assert density.bulk_density(0.6, 2600.0) == pytest.approx(1560.0)
    masses = density.mass_shares([0.5, 0.5], [3000.0, 2000.0])
    assert masses == pytest.approx([0.6, 0.4])
    assert density.solid_volume_shares(masses, [3000.0, 2000.0]) == pytest.approx([0.5, 0.5])


@given(st.lists(st.integers(1, 240), min_size=1, max_size=4))
def test_whatever_is_typed_shares_sum_to_one_or_are_none(tenths: list[int]) -> None:
    read = experiments.read_shares([f"{one / 10:.1f}".replace(".", ",") for one in tenths])
    assert read.rest == pytest.approx(100.0 - sum(tenths) / 10)
    assert read.shares is not None
    assert math.fsum(read.shares) == pytest.approx(1.0, abs=1e-12)
    assert min(read.shares) > 0.0


@pytest.mark.parametrize(
    ("texts", "place", "sentence"),
    [
        (["60", "50,5"], 2, "the others sum to 110.5 %, which leaves -10.5 %, not above 0; lower one of them"),
        (["60", "40"], 2, "the others sum to 100 %, which leaves 0 %, not above 0; lower one of them"),
        (["much", "50"], 0, "'much' is no number; write it like 12.5 % or 12,5 %, without thousands separators"),
        (["20", "0"], 1, "0 must be above 0; correct it"),
        (["20", ""], 1, "'' is no number; write it like 12.5 % or 12,5 %, without thousands separators"),
    ],
)
def test_shares_that_cannot_be_are_named_beside_their_aggregate(texts: list[str], place: int, sentence: str) -> None:
    read = experiments.read_shares(texts)
    assert read.shares is None
    assert [text for text in read.wrong if text] == [sentence]
    assert read.wrong[place] == sentence


def ids(target: Store, *names: str) -> list[int]:
    with target.read() as session:
        return [row.id for row in store_module.aggregates(session, names)]


def dense(target: Store, folder: Path) -> None:
    lines = "name,particle_density_kg_m3,density_basis\npebbles L,3000,oven_dry\npebbles F,2000,oven_dry\n"
    (folder / "aggregates.csv").write_text(lines)
    experiments.register(target, read_path(folder / "aggregates.csv"))


def test_a_mixture_by_mass_is_kept_as_its_table_would_be(pebbles: Store, tmp_path: Path) -> None:
    parts = ids(pebbles, "pebbles L", "pebbles F")
    with pytest.raises(InputError, match="need a particle density of pebbles L, pebbles F; enter it"):
        experiments.compose(pebbles, parts, [0.6, 0.4], by_mass=True)
    dense(pebbles, tmp_path)
    composed = experiments.compose(pebbles, parts, [0.6, 0.4], by_mass=True)
    assert composed.shares == pytest.approx((0.5, 0.5))
    assert composed.mass_shares == pytest.approx((0.6, 0.4))
    assert composed.particle_density == pytest.approx(2500.0)
    made = experiments.register_mixture(pebbles, " heavy ", parts, [0.6, 0.4], by_mass=True)
    kept = experiments.composition(pebbles, made)
    assert (kept.name, kept.names) == ("heavy", ("pebbles L", "pebbles F"))
    assert kept.shares == pytest.approx((0.5, 0.5))
    with pebbles.read() as session:
        blend = store_module.mixtures(session, ["heavy"])[0]
    assert [part.mass_share for part in blend.components] == [0.6, 0.4]
    assert experiments.mixture_names(pebbles, 1) == {made: "heavy"}


def test_an_equal_mixture_is_found_and_another_of_its_name_refused(pebbles: Store) -> None:
    parts = ids(pebbles, "pebbles L", "pebbles F")
    made = experiments.register_mixture(pebbles, "M", parts, [0.5, 0.5], by_mass=False)
    assert experiments.register_mixture(pebbles, "M", parts, [0.5, 0.5], by_mass=False) == made
    for name, shares in (("M", [0.25, 0.75]), (" ", [0.5, 0.5])):
        with pytest.raises(TableError):
            experiments.register_mixture(pebbles, name, parts, shares, by_mass=False)


def test_of_an_aggregate_with_several_deliveries_the_chosen_one_is_taken(pebbles: Store, tmp_path: Path) -> None:
    (old,) = ids(pebbles, "pebbles L")
    (tmp_path / "aggregates.csv").write_text("name,delivery\npebbles L,May\n")
    experiments.register(pebbles, read_path(tmp_path / "aggregates.csv"))
    (new,) = ids(pebbles, "pebbles L")
    (fine,) = ids(pebbles, "pebbles F")
    for key, name in ((old, "pebbles L"), (new, "pebbles L May")):
        made = experiments.register_mixture(pebbles, f"of {key}", [key, fine], [0.5, 0.5], by_mass=False)
        assert experiments.composition(pebbles, made).names == (name, "pebbles F")
    kept = experiments.composition(pebbles, made)
    assert (kept.unsieved, kept.combined) == (("pebbles L May",), None)
    assert kept.undense == ("pebbles L May", "pebbles F")
    assert (kept.particle_density, kept.mass_shares) == (None, None)


def test_what_is_not_there_is_named(pebbles: Store) -> None:
    for call in (experiments.composition, lambda target, key: experiments.ask_prediction(target, key, "auto")):
        with pytest.raises(UnknownName, match="no mixture 99"):
            call(pebbles, 99)
    with pytest.raises(UnknownName, match="no aggregate 99"):
        experiments.compose(pebbles, [99], [1.0], by_mass=False)
    with pytest.raises(UnknownName, match="no prediction 99"):
        experiments.prediction_bed(pebbles, 99, 10)


def wished(target: Store) -> int:
    (mixture_id, *_) = experiments.mixture_names(target, 1)
    assert experiments.ask_prediction(target, mixture_id, "monosized") == ""
    return mixture_id


def test_a_prediction_is_wished_for_once_and_none_where_it_is_there(pebbles: Store) -> None:
    mixture_id = wished(pebbles)
    first = experiments.waiting_prediction(pebbles, mixture_id)
    assert experiments.waiting_prediction(pebbles, wished(pebbles)) == first
    assert first is not None
    assert (first.method, first.state, first.progress, first.left, first.attended) == (
        "monosized", "queued", 0.0, None, True,
    )  # fmt: skip
    assert experiments.cancel(pebbles, [first.key]) == 1
    assert experiments.waiting_prediction(pebbles, mixture_id) is None
    experiments.predict(pebbles, FormulaRunner(pebbles))
    wished(pebbles)
    assert experiments.waiting_prediction(pebbles, mixture_id) is None


def set_wish(target: Store, key: int, **values: object) -> None:
    with target.write() as session:
        row = session.get(Prediction, key)
        for name, value in values.items():
            setattr(row, name, value)


def test_time_left_is_by_the_pace_since_it_was_asked_for(pebbles: Store) -> None:
    mixture_id = wished(pebbles)
    asked = experiments.waiting_prediction(pebbles, mixture_id)
    assert asked is not None
    moment = now()
    begun = moment - dt.timedelta(seconds=30)
    set_wish(pebbles, asked.key[1], state="running", requested_at=begun, heartbeat=moment, progress=0.25)
    found = experiments.waiting_prediction(pebbles, mixture_id)
    assert found is not None
    assert (found.left, found.attended) == (pytest.approx(90.0), True)


def test_a_wish_that_no_runner_takes_up_or_whose_runner_is_dead_is_not_attended(pebbles: Store) -> None:
    mixture_id = wished(pebbles)
    asked = experiments.waiting_prediction(pebbles, mixture_id)
    assert asked is not None
    long_ago = now() - dt.timedelta(seconds=waiting.PATIENCE + 1.0)
    set_wish(pebbles, asked.key[1], requested_at=long_ago)

    def attended() -> bool:
        found = experiments.waiting_prediction(pebbles, mixture_id)
        assert found is not None
        return found.attended

    assert not attended()
    (aggregate_id,) = ids(pebbles, "pebbles L")
    assert experiments.ask_calibration(pebbles, aggregate_id, "monosized") == ""
    with pebbles.write() as session:
        other = store_module.waiting_calibration(session, aggregate_id)
        assert other is not None
        other.state, other.heartbeat = "running", now()
    assert attended(), "a runner is at work, on another wish"
    lost = now() - dt.timedelta(seconds=store_module.LEASE + 1.0)
    set_wish(pebbles, asked.key[1], state="running", heartbeat=lost)
    assert not attended()


def test_a_wish_s_place_in_line_is_the_one_in_which_a_runner_takes_it_up(pebbles: Store) -> None:
    (aggregate_id,) = ids(pebbles, "pebbles L")
    mixtures = list(experiments.mixture_names(pebbles, 3))
    for mixture_id in mixtures:
        assert experiments.ask_prediction(pebbles, mixture_id, "monosized") == ""
    assert experiments.ask_calibration(pebbles, aggregate_id, "monosized") == ""
    asked = [found for key in mixtures if (found := experiments.waiting_prediction(pebbles, key)) is not None]
    last = experiments.waiting_calibration(pebbles, aggregate_id)
    assert last is not None
    set_wish(pebbles, asked[2].key[1], priority=1)
    places = {
        found.key: found.before
        for found in (*(experiments.waiting_prediction(pebbles, key) for key in mixtures), last)
        if found is not None
    }
    assert sorted(places.values()) == [0, 1, 2, 3]
    with pebbles.write() as session:
        for key in sorted(places, key=places.__getitem__):
            assert store_module.claim_wishes(session, "runner", 1, lambda name: False) == [key]


def test_wishes_of_the_same_moment_stand_in_line_by_kind_and_age(pebbles: Store) -> None:
    (aggregate_id,) = ids(pebbles, "pebbles L")
    mixtures = list(experiments.mixture_names(pebbles, 2))
    for mixture_id in mixtures:
        experiments.ask_prediction(pebbles, mixture_id, "monosized")
    experiments.ask_calibration(pebbles, aggregate_id, "monosized")
    with pebbles.write() as session:
        for table in (Prediction, Calibration):
            session.execute(sa.update(table).values(requested_at=dt.datetime(2026, 1, 1, tzinfo=dt.UTC)))
    found = [experiments.waiting_prediction(pebbles, key) for key in mixtures]
    assert [one.before for one in found if one is not None] == [1, 2]
    first = experiments.waiting_calibration(pebbles, aggregate_id)
    assert first is not None
    assert first.before == 0


def keep_bed(target: Store, prediction_id: int, count: int) -> Run:
    """Keep a bed of the first run, its spheres in a row along y, outside the box, species in turn."""
    with target.write() as session:
        row = store_module.predictions_by_id(session, [prediction_id])[0]
        runs = [session.get(Run, link.specimen_hash) for link in row.runs]
        run = min((one for one in runs if one is not None), key=lambda one: one.seed)
        specimen = from_canonical(run.specimen)
        species = np.arange(count, dtype=np.uint8) % len(specimen.species)
        radius = np.array([0.5 * kind.diameter for kind in specimen.species])[species]
        along = specimen.width * (1.0 + np.arange(count)[::-1] / count)
        place = np.stack([np.full(count, -0.5), along, np.full(count, 0.5), radius], axis=1)
        file = io.BytesIO()
        np.savez(file, place=place, species=species)
        session.add(RunState(specimen_hash=run.specimen_hash, steps=1, archive=file.getvalue()))
        return run


@pytest.mark.parametrize("method", ["monosized", "graded", "drop_and_roll"])
def test_a_bed_is_drawn_in_millimetres_with_the_aggregate_of_each_sphere(pebbles: Store, method: str) -> None:
    report = experiments.predict(pebbles, FormulaRunner(pebbles), ["pebbles L+F 1:1"], Way(method))[0]
    assert report.prediction_id is not None
    with pytest.raises(InputError, match="no bed of the prediction of 'pebbles L\\+F 1:1' is kept"):
        experiments.prediction_bed(pebbles, report.prediction_id, 10)
    run = keep_bed(pebbles, report.prediction_id, 40)
    bed = experiments.prediction_bed(pebbles, report.prediction_id, 1000)
    assert (bed.total, len(bed.place), bed.digest, bed.seed) == (40, 40, run.specimen_hash, 1)
    assert sorted(bed.names) == ["pebbles F", "pebbles L"]
    coarse, fine = (2.0 * bed.place[bed.part == bed.names.index(f"pebbles {name}"), 3] for name in "LF")
    assert coarse.min() > 40.64
    assert coarse.max() < 60.96
    assert fine.max() < coarse.min()
    assert (bed.place[:, :2] >= 0.0).all(), "within the periodic box"


def test_of_a_large_bed_the_spheres_in_front_are_drawn(pebbles: Store) -> None:
    report = experiments.predict(pebbles, FormulaRunner(pebbles), ["pebbles L+F 1:1"])[0]
    assert report.prediction_id is not None
    keep_bed(pebbles, report.prediction_id, 40)
    whole = experiments.prediction_bed(pebbles, report.prediction_id, 40)
    front = experiments.prediction_bed(pebbles, report.prediction_id, 10)
    assert (len(front.place), front.total) == (10, 40)
    assert front.place[:, 1].max() <= np.sort(whole.place[:, 1])[9]


def test_a_bed_of_a_mixture_that_was_corrected_is_not_drawn_as_another(pebbles: Store) -> None:
    report = experiments.predict(pebbles, FormulaRunner(pebbles), ["pebbles L+F 1:1"])[0]
    assert report.prediction_id is not None
    keep_bed(pebbles, report.prediction_id, 8)
    (medium,) = ids(pebbles, "pebbles M")
    with pebbles.write() as session:
        row = store_module.mixtures(session, ["pebbles L+F 1:1"])[0]
        row.components[1].aggregate_id = medium
    with pytest.raises(InputError, match="was corrected since"):
        experiments.prediction_bed(pebbles, report.prediction_id, 10)
