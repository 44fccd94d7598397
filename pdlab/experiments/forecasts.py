"""Which beds predictions will take that the store does not hold yet, told before they are run."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from pdlab import calibration, mixture, store
from pdlab.errors import PdlabError
from pdlab.experiments.calibrations import CalibrationReport, calibrating
from pdlab.experiments.opening import Open, open_calibration
from pdlab.experiments.predictions import open_blend
from pdlab.experiments.readings import particle_density
from pdlab.experiments.references import ORDERED, REFERENCES, parts_of
from pdlab.experiments.theories import components_of
from pdlab.experiments.ways import AUTO, Way
from pdlab.models import Aggregate, Mixture
from pdlab.plan import at_once
from pdlab.specimen import Specimen
from pdlab.store import Store

LIKELY = (0.1, 0.2, 0.3)
"""Nodes of a curve that a calibration mostly takes, of which the middle one stands for a coefficient not yet known."""


def beds_to_run(target: Store, rows: Sequence[Mixture], way: Way, engine_version: int) -> list[Specimen]:
    """Return the beds that mixtures will take first and the store does not hold, equal ones once.

    Aggregates whose calibration takes beds are guessed to take three nodes of their curve, and to have the middle
    one's coefficient. What cannot be predicted takes none.
    """
    with target.read() as session:
        parts = store.aggregates_by_id(session, components_of(rows))
    beds = list[Specimen]()
    if way.method in REFERENCES:
        known = {part.id: part for part in parts}
        for row in rows if way.method != ORDERED else ():
            beds += _first(partial(parts_of, row, known, way.method, way.rule, way.pan_factor), way)
    else:
        reports = dict[int, CalibrationReport]()
        for part in parts:
            reports[part.id], needed = _calibration(target, part, way, engine_version)
            beds += needed
        for row in rows:
            beds += _first(partial(_parts, row, reports), way)
    by_digest = {bed.digest(engine_version): bed for bed in beds}
    with target.read() as session:
        there = store.done_digests(session, list(by_digest))
    return [bed for digest, bed in by_digest.items() if digest not in there]


def _first(parts: Callable[[], Sequence[mixture.Part]], way: Way) -> list[Specimen]:
    """Return the beds that a mixture takes first, none of one that cannot be predicted: its row will say why."""
    try:
        found = parts()
        return mixture.next_specimens(found, [], way.seeds) if found else []
    except PdlabError:
        return []


def _parts(row: Mixture, reports: dict[int, CalibrationReport]) -> Sequence[mixture.Part]:
    return open_blend(row, reports).parts


def _calibration(
    target: Store, row: Aggregate, way: Way, engine_version: int
) -> tuple[CalibrationReport, list[Specimen]]:
    """Return an aggregate's calibration, or a likely one and the beds that it takes."""
    found = at_once(calibrating(target, [row], way, engine_version))
    if found is not None:
        return found[0], []
    one = open_calibration(row, way)
    if way.method == AUTO:
        one.method = calibration.MONOSIZED
    beds = [bed for node in LIKELY for bed in one.ladder().beds(node, way.seeds)]
    return _likely(one), beds


def _likely(one: Open) -> CalibrationReport:
    friction, rolling = one.ladder().coefficients(LIKELY[1])
    value = one.measured.value
    guess = calibration.Calibrated(LIKELY[1], None, None, value, 0.0, 0.0)
    report = CalibrationReport(one.aggregate.name, one.aggregate.id, calibration_id=0, method=one.method, result=guess)
    return replace(
        report, sizes=one.sizes(one.method), measured=value, protocol=one.protocol, friction=friction, rolling=rolling,
        density=particle_density(one.aggregate),
    )  # fmt: skip
