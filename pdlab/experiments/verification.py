"""Repeat stored runs and compare: to the bit on the same machine, within the seeds' scatter elsewhere."""

import io
import json
import math
import random
import zipfile
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pdlab import store
from pdlab.errors import InputError, ProtocolError
from pdlab.models import Run, RunState
from pdlab.specimen import Specimen, from_canonical
from pdlab.store import Store

Kept = tuple[Run, RunState | None]
"""A run and its bed as they are kept in the store."""
Repeat = Callable[[Sequence[Specimen]], list[Kept]]
"""Runs specimens, whatever the store holds, and writes nothing; returns in order what would be kept."""

ERRORS = 3.0
"""Standard errors by which a run repeated on another machine may be off."""
LEAST_BEDS = 4
"""Beds of one specimen whose results give a deviation of its own."""
EXACT = ("state", "packing_density", "repose_angle_deg", "coordination_number", "steps")
"""What equal machines give to the bit, beside the bed."""
EQUAL, CLOSE, DIFFERS, OTHER_ENGINE, UNJUDGED = (
    "equal", "within 3 standard errors", "differs", "another engine version", "not judged",
)  # fmt: skip


@dataclass(frozen=True)
class Verified:
    """What a repeated run showed: ``verdict``, and ``message`` where it is not plain.

    ``quantity``: packing_density [-], or repose_angle_deg [degrees] of a heap, as ``stored`` and ``repeated``;
    ``allowed``: the difference that is allowed, 0 where bits are compared, None where nothing was.
    """

    specimen_hash: str
    verdict: str
    quantity: str
    stored: float | None = None
    repeated: float | None = None
    allowed: float | None = None
    message: str = ""


def verify(
    target: Store, repeat: Repeat, engine_version: int, sample: int | None = None, seed: int = 1
) -> list[Verified]:
    """Repeat stored runs that are done, all or ``sample`` drawn by ``seed``, and compare; the store stays as it is.

    Runs of another engine version than ``engine_version`` are told apart and not repeated. Raises InputError for
    a ``sample`` below 1.
    """
    if sample is not None and sample < 1:
        raise InputError(f"a sample of {sample} runs is none; ask for 1 or more")
    with target.read() as session:
        done = sorted((run for run in store.runs(session) if run.state == "done"), key=lambda run: run.specimen_hash)
    current = [run for run in done if run.engine_version == engine_version]
    others = [_other_engine(run) for run in done if run.engine_version != engine_version]
    drawn = current if sample is None or sample >= len(current) else random.Random(seed).sample(current, sample)
    deviations = _Deviations(current)
    sound, out = [], []
    for run in drawn:
        problem, specimen = _specimen(run)
        if specimen is None:
            out.append(_verified(run, DIFFERS, message=problem))
        else:
            sound.append((run, specimen))
    repeated = repeat([specimen for _, specimen in sound])
    for (run, _), kept in zip(sound, repeated, strict=True):
        with target.read() as session:  # one bed at a time: they are large
            bed = store.find_row(session, RunState, run.specimen_hash)
        out.append(_compare(run, bed, kept, deviations))
    return [*out, *others]


def _specimen(run: Run) -> tuple[str, Specimen | None]:
    """Return what is wrong with a run's specimen, and the specimen where nothing is."""
    try:
        specimen = from_canonical(run.specimen)
    except ProtocolError as error:
        return str(error), None
    if specimen.digest(run.engine_version) != run.specimen_hash:
        return "its specimen is not the one that its hash names", None
    return "", specimen


def _verified(
    run: Run, verdict: str, other: Run | None = None, allowed: float | None = None, message: str = ""
) -> Verified:
    quantity = _quantity(run)
    repeated = None if other is None else getattr(other, quantity)
    return Verified(run.specimen_hash, verdict, quantity, getattr(run, quantity), repeated, allowed, message)


def _quantity(run: Run) -> str:
    """Return which column holds a run's result."""
    return "packing_density" if run.repose_angle_deg is None else "repose_angle_deg"


def _result(run: Run) -> float | None:
    value: float | None = getattr(run, _quantity(run))
    return value


def _other_engine(run: Run) -> Verified:
    return _verified(run, OTHER_ENGINE, message=f"of engine version {run.engine_version}")


def _compare(run: Run, bed: RunState | None, kept: Kept, deviations: "_Deviations") -> Verified:
    other, other_bed = kept
    here = (other.numba_version, other.processor)
    if (run.numba_version, run.processor) == here:
        wrong = [name for name in EXACT if getattr(run, name) != getattr(other, name)]
        if bed is not None and not _equal_beds(bed, other_bed):
            wrong.append("the bed")
        message = f"not equal: {', '.join(wrong)}" if wrong else "" if bed else "it keeps no bed: numbers alone"
        return _verified(run, DIFFERS if wrong else EQUAL, other, 0.0, message)
    machine = f"made with numba {run.numba_version} on {run.processor}, here {here[0]} on {here[1]}"
    here_now, there = _result(other), _result(run)
    if here_now is None or there is None or _quantity(other) != _quantity(run):
        return _verified(run, DIFFERS, other, message=f"{other.error}; {machine}")
    deviation, source = deviations.of(run)
    if math.isnan(deviation):
        return _verified(run, UNJUDGED, other, message=f"{source}; {machine}")
    allowed = ERRORS * math.sqrt(2.0) * deviation  # the difference of two beds, each with this deviation
    near = abs(here_now - there) <= allowed
    return _verified(run, CLOSE if near else DIFFERS, other, allowed, f"{source}; {machine}")


def _equal_beds(one: RunState, other: RunState | None) -> bool:
    """Return whether two beds have the same bytes of places and species."""
    if other is None:
        return False
    try:
        with np.load(io.BytesIO(one.archive)) as first, np.load(io.BytesIO(other.archive)) as second:
            pairs = [(first[name], second[name]) for name in ("place", "species")]
    except (ValueError, KeyError, OSError, zipfile.BadZipFile):
        return False
    return all(a.shape == b.shape and a.dtype == b.dtype and a.tobytes() == b.tobytes() for a, b in pairs)


class _Deviations:
    """How much the results of one specimen's seeds scatter in the store: PDs, and angles apart from them."""

    def __init__(self, runs: Sequence[Run]) -> None:
        self._values = defaultdict[tuple[str, str], list[float]](list)
        for run in runs:
            value = _result(run)
            if value is not None:
                self._values[_quantity(run), _but_seed(run)].append(value)

    def of(self, run: Run) -> tuple[float, str]:
        """Return the standard deviation of one run's result, and whence: its own seeds, from 4 on, else all specimens'.

        NaN where no specimen with such a result has two seeds in the store.
        """
        own = self._values[_quantity(run), _but_seed(run)]
        if len(own) >= LEAST_BEDS:
            return float(np.std(own, ddof=1)), f"deviation of its {len(own)} seeds"
        groups = [values for (kind, _), values in self._values.items() if kind == _quantity(run) and len(values) > 1]
        freedom = sum(len(values) - 1 for values in groups)
        if not freedom:
            return math.nan, "no specimen of the store has two seeds to tell its deviation"
        squares = sum((len(values) - 1) * float(np.var(values, ddof=1)) for values in groups)
        return math.sqrt(squares / freedom), f"it has {len(own)} seeds: deviation pooled over all specimens"


def _but_seed(run: Run) -> str:
    try:
        content = json.loads(run.specimen)
        return json.dumps({**content, "seed": None}, sort_keys=True)
    except (ValueError, TypeError):
        return run.specimen_hash
