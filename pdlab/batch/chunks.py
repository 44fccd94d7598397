"""What a worker does: advance a bed by a chunk of steps, and measure it when it rests. Workers know no database."""

import io
import time
from dataclasses import fields, replace
from typing import Any, NamedTuple

import numpy as np

from pdlab import packing
from pdlab.dem.bed import rest_free
from pdlab.errors import EngineError
from pdlab.specimen import Packing, Specimen


class Advanced(NamedTuple):
    """A bed after a chunk: how far it is, the seconds that took, by which numba and processor, and what it shows.

    ``state`` while it moves; at rest its ``result`` and the ``archive`` of where the spheres lie.
    """

    progress: packing.Progress
    seconds: float
    engine: str
    state: packing.State | None = None
    result: Packing | None = None
    archive: bytes = b""


def advance(specimen: Specimen, state: packing.State | None, steps: int, threads: int = 1) -> Advanced:
    """Advance a bed by at most so many steps, from its beginning where ``state`` is None.

    Raises EngineError, with the bed as it was left.
    """
    begun, engine = time.perf_counter(), " ".join(packing.fingerprint()[name] for name in ("numba", "cpu"))
    try:
        state = packing.advance(specimen, state, steps, threads)
        seconds, progress = time.perf_counter() - begun, packing.progress(specimen, state)
        if not state.rest:
            return Advanced(progress, seconds, engine, state)
        result = packing.measure(specimen, state, seconds)
    except EngineError as error:
        error.state, error.engine = error.state or state, engine
        raise
    return Advanced(progress, seconds, engine, result=result, archive=where(state))


def where(state: packing.State) -> bytes:
    """Return where the spheres of a bed lie, as a compressed NumPy archive."""
    return _archive({"place": state.place, "species": state.species.astype(np.uint8)})


def checkpoint(state: packing.State) -> bytes:
    """Return a bed with all that its next step needs, as a compressed NumPy archive."""
    arrays: dict[str, Any] = {"place": state.place, "species": state.species.astype(np.uint8)}
    for one in fields(packing.State):
        value = getattr(state, one.name)
        if isinstance(value, tuple):  # a list of contacts
            arrays |= {f"{one.name}.{name}": part for name, part in value._asdict().items()}  # type: ignore[attr-defined]
        elif one.name not in arrays:
            arrays[one.name] = np.asarray(value)
    return _archive(arrays)


def read_checkpoint(archive: bytes) -> packing.State | None:
    """Return the bed of a checkpoint; None of an archive that only says where its spheres lie."""
    with np.load(io.BytesIO(archive)) as kept:
        if "motion" not in kept:
            return None
        empty, found = rest_free(kept["place"], kept["species"]), dict[str, Any]()
        for one in fields(packing.State):
            usual = getattr(empty, one.name)
            if isinstance(usual, tuple):
                names = usual._fields  # type: ignore[attr-defined]
                found[one.name] = type(usual)(*(kept[f"{one.name}.{name}"] for name in names))
            elif isinstance(usual, np.ndarray):
                found[one.name] = kept[one.name].astype(usual.dtype)
            else:
                found[one.name] = type(usual)(kept[one.name].item())
    return replace(empty, **found)


def _archive(arrays: dict[str, Any]) -> bytes:
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()
