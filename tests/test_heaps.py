"""Heaps as runs of the store: their angle and bed are kept, read, repeated, compared and shown."""

import io
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import sqlalchemy as sa
from conftest import ThreadsPool

from pdlab import bedfiles, packing
from pdlab.batch.runner import Repeater, Runner
from pdlab.experiments import verify
from pdlab.lab import Lab
from pdlab.models import Run, RunState
from pdlab.specimen import REPOSE, Packing, equal_spheres, heap_spheres
from pdlab.store import Store, open_store

SMALL = replace(REPOSE, base_diameter=12.0, lift_speed=2.0, nominal_overlap=0.01)
HEAP = heap_spheres(0.3, 1, wall_friction=0.4, protocol=SMALL)


@pytest.fixture(scope="module")
def heaped(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Store, Packing]]:
    """A store with one small heap by the engine, and what the runner said of it."""
    target = open_store(str(tmp_path_factory.mktemp("heap") / "lab.db"))
    (said,) = Runner(target, ThreadsPool(1))([HEAP])
    assert isinstance(said, Packing)
    yield target, said
    target.close()


def spoiled(run: Run, **values: Any) -> Run:
    """A run as it might come out elsewhere."""
    return Run(**{column.name: getattr(run, column.name) for column in sa.inspect(Run).columns} | values)


def test_a_heap_in_the_store_has_its_angle_and_bed_and_no_packing_density(heaped: tuple[Store, Packing]) -> None:
    target, said = heaped
    with target.read() as session:
        run, kept = session.get(Run, said.digest), session.get(RunState, said.digest)
        assert run is not None
        assert kept is not None
        assert (run.state, run.packing_density, run.repose_angle_deg) == ("done", None, said.repose_angle_deg)
        place = np.load(io.BytesIO(kept.archive))["place"]
    assert len(place) < HEAP.spheres


def test_a_heap_is_read_from_the_store_as_it_came_out_and_never_run_again(heaped: tuple[Store, Packing]) -> None:
    target, said = heaped
    again = Runner(target, ThreadsPool(1))
    (read,) = again([HEAP])
    assert again.simulated == 0
    assert isinstance(read, Packing)
    assert np.isnan(read.packing_density)
    assert replace(read, packing_density=0.0) == replace(said, packing_density=0.0)


def test_a_heap_repeats_to_the_bit(heaped: tuple[Store, Packing]) -> None:
    target, said = heaped
    again = Repeater(target, ThreadsPool(1))
    (found,) = verify(target, again.repeat, again.engine_version)
    assert (found.verdict, found.quantity, found.message) == ("equal", "repose_angle_deg", "")
    assert found.stored == found.repeated == said.repose_angle_deg


def test_an_angle_that_is_off_in_its_last_bit_is_found(heaped: tuple[Store, Packing]) -> None:
    target, said = heaped
    off = float(np.nextafter(said.repose_angle_deg or 0.0, 90.0))

    def repeat(beds: Any) -> Any:
        with target.read() as session:
            run, kept = session.get(Run, said.digest), session.get(RunState, said.digest)
            assert run is not None
            return [(spoiled(run, repose_angle_deg=off), kept) for _ in beds]

    (found,) = verify(target, repeat, packing.VERSION)
    assert (found.verdict, found.message) == ("differs", "not equal: repose_angle_deg")


@pytest.mark.parametrize("angles", [(20.0, 21.0, 19.5, 20.5), (20.0, 21.0)], ids=["own seeds", "pooled"])
@pytest.mark.parametrize(("off", "verdict"), [(2.9, "within 3 standard errors"), (3.1, "differs")])
def test_elsewhere_an_angle_is_judged_by_the_scatter_of_angles_alone(
    heaped: tuple[Store, Packing], tmp_path: Path, angles: tuple[float, ...], off: float, verdict: str
) -> None:
    with heaped[0].read() as session:
        first = session.get(Run, heaped[1].digest)
        assert first is not None
    target, deviation = open_store(str(tmp_path / "lab.db")), float(np.std(angles, ddof=1))
    heaps = [(replace(HEAP, seed=k), {"repose_angle_deg": angle}) for k, angle in enumerate(angles, 1)]
    beds = [(equal_spheres(0.3, k), {"repose_angle_deg": None, "packing_density": 0.5 + 0.001 * k}) for k in (1, 2)]
    with target.write() as session:
        for one, values in (*heaps, *beds):
            text = {"specimen_hash": one.digest(packing.VERSION), "specimen": one.canonical(packing.VERSION)}
            session.add(spoiled(first, processor="z80", **text, **values))

    def repeat(specimens: Any) -> Any:
        here = packing.fingerprint()
        moved = {"processor": here["cpu"], "numba_version": here["numba"]}
        with target.read() as session:
            rows = [session.get_one(Run, one.digest(packing.VERSION)) for one in specimens]
            further = off * 2.0**0.5 * deviation
            angles = [row.repose_angle_deg and row.repose_angle_deg + further for row in rows]
            return [
                (spoiled(row, repose_angle_deg=angle, **moved), None) for row, angle in zip(rows, angles, strict=True)
            ]

    found = [one for one in verify(target, repeat, packing.VERSION) if one.quantity == "repose_angle_deg"]
    assert len(found) == len(angles)
    assert {one.verdict for one in found} == {verdict}
    assert found[0].allowed == pytest.approx(3.0 * 2.0**0.5 * deviation)
    target.close()


def test_a_stored_heap_stands_about_its_axis_and_shows_its_flank(heaped: tuple[Store, Packing], tmp_path: Path) -> None:
    target, said = heaped
    with Lab(target.url) as lab:
        bed = lab.bed(said.digest)
        listed = lab.runs(columns=["packing_density", "repose_angle_deg"])
    assert listed["repose_angle_deg"][0] == said.repose_angle_deg
    assert pd.isna(listed["packing_density"][0])
    assert bed.flank is not None
    assert bed.flank.angle == said.repose_angle_deg
    assert np.isnan(bed.packing_density)
    off = np.hypot(bed.place[:, 0], bed.place[:, 1])
    assert off.max() < 0.5 * SMALL.base_diameter + 0.5
    assert float(bed.contacts_by_species.sum()) == pytest.approx(said.coordination_number)
    bedfiles.write_profiles(bed, tmp_path / "heap.csv", 10.0)
    table = pd.read_csv(tmp_path / "heap.csv")
    assert set(table["profile"]) == {"surface_height_mm"}
    assert table["to_mm"].max() == pytest.approx(10.0 * 0.5 * SMALL.base_diameter)
    assert table["value"].head(20).mean() > table["value"].tail(20).mean() > 5.0
