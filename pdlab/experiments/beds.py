"""A bed that a prediction rests on, as plain arrays to be drawn."""

import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from sqlalchemy.orm import Session

from pdlab import mixture, store
from pdlab.errors import InputError, UnknownName
from pdlab.experiments import references
from pdlab.experiments.calibrations import calibration_report
from pdlab.experiments.predictions import open_blend
from pdlab.experiments.readings import specimen_kept
from pdlab.experiments.references import REFERENCES
from pdlab.models import Prediction, Run, RunState
from pdlab.specimen import Specimen, components, on_grid
from pdlab.store import Store


@dataclass(frozen=True)
class DrawnBed:
    """Spheres of a bed: ``place`` (N, 4), x, y, z and radius [mm], and ``part`` (N,), where its name stands.

    ``names``: of the aggregates; spheres that several of them have alike go by all their names. ``total``: spheres of
    the whole bed, of which the N in front are given. ``digest``, ``seed``: of its run.
    """

    place: np.ndarray
    part: np.ndarray
    names: tuple[str, ...]
    total: int
    digest: str
    seed: int


def prediction_bed(target: Store, prediction_id: int, most: int) -> DrawnBed:
    """Return the first bed that a prediction rests on, at most so many spheres: those of the smallest y.

    Raises UnknownName, and InputError where no bed is kept or its mixture is another since.
    """
    with target.read() as session:
        row = next(iter(store.predictions_by_id(session, [prediction_id])), None)
        if row is None:
            raise UnknownName(f"the store holds no prediction {prediction_id}; choose another")
        run, archive = _first_bed(session, row)
        parts = _parts(session, row)
    specimen, scale = specimen_kept(run), max(size for part in parts for size, _ in part.sizes)
    names, of_species = _named(specimen, parts, scale)
    with np.load(io.BytesIO(archive)) as kept:
        place, species = np.array(kept["place"], dtype=np.float64), kept["species"].astype(np.int64)
    place[:, :2] %= specimen.width  # a mixture's bed is periodic
    front = np.sort(np.argsort(place[:, 1], kind="stable")[:most])
    return DrawnBed(
        scale * place[front], np.array(of_species)[species[front]], names, len(place), run.specimen_hash, run.seed
    )


def _first_bed(session: Session, row: Prediction) -> tuple[Run, bytes]:
    """Return the run of the smallest seed that keeps a bed, with its archive."""
    found = [store.find_row(session, Run, link.specimen_hash) for link in row.runs]
    for run in sorted((run for run in found if run is not None), key=lambda run: run.seed):
        if (bed := store.find_row(session, RunState, run.specimen_hash)) is not None:
            return run, bed.archive
    raise InputError(f"no bed of the prediction of '{row.mixture.name}' is kept; there is none to draw")


def _parts(session: Session, row: Prediction) -> Sequence[mixture.Part]:
    """Return the mixture's aggregates as they were simulated."""
    if row.method in REFERENCES:
        ids = [part.aggregate_id for part in row.mixture.components]
        aggregates = {one.id: one for one in store.aggregates_by_id(session, ids)}
        return references.parts_of(row.mixture, aggregates, row.method, references.rule_of(row))
    fits = [link.calibration for link in row.calibrations]
    known = {fit.aggregate_id: calibration_report(fit.aggregate, fit) for fit in fits}
    if known.keys() != {part.aggregate_id for part in row.mixture.components}:
        raise _other_since(row.mixture.name)
    return open_blend(row.mixture, known).parts


def _named(specimen: Specimen, parts: Sequence[mixture.Part], largest: float) -> tuple[tuple[str, ...], list[int]]:
    """Return the names of those that have spheres alike, and for each species where its name stands."""
    of_kind = dict[tuple[float, float, float], list[str]]()
    for part in parts:
        for one in components(part.sizes, part.friction, part.rolling):
            key = (on_grid(one.diameter / largest), on_grid(one.friction), on_grid(one.rolling))
            of_kind.setdefault(key, []).append(part.aggregate)
    keys = [(kind.diameter, kind.friction, kind.rolling) for kind in specimen.species]
    if any(key not in of_kind for key in keys):
        raise _other_since(" + ".join(part.aggregate for part in parts))
    said = [" and ".join(of_kind[key]) for key in keys]
    names = tuple(dict.fromkeys(said))
    return names, [names.index(one) for one in said]


def _other_since(name: str) -> InputError:
    return InputError(f"'{name}' was corrected since its bed was simulated; predict it again")
