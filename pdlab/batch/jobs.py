"""A bed on its way: its last state and what it took, and the rows that are kept of it."""

import json
import math
from dataclasses import dataclass, field

from pdlab import packing
from pdlab.batch.chunks import Advanced, checkpoint, read_checkpoint, where
from pdlab.errors import EngineError
from pdlab.models import Run, RunState, now
from pdlab.specimen import Specimen

CHUNK = 20_000_000
"""Sphere-steps handed out at once: a few seconds."""
MEASURES = (
    "repose_angle_deg", "coordination_number", "height", "largest_overlap", "rest", "steps",
)  # fmt: skip


@dataclass(eq=False)
class Job:
    """A specimen on its way: its bed after the last chunk, the seconds spent, by which numbas and processors.

    ``claimed``: its run is this runner's; ``kept_at``: when its bed was kept last; ``lost``: how often in a row its
    worker died.
    """

    specimen: Specimen
    digest: str
    state: packing.State | None = None
    progress: packing.Progress | None = None
    seconds: float = 0.0
    engines: list[str] = field(default_factory=list)
    claimed: bool = False
    kept_at: float = math.inf
    lost: int = 0

    @property
    def steps(self) -> int:
        """The steps of a chunk."""
        return max(1, CHUNK // self.specimen.spheres)

    @property
    def share(self) -> float:
        """A guess at the share of its steps that lie behind it."""
        return 0.0 if self.progress is None else self.progress.share

    def take(self, chunk: Advanced) -> None:
        """Take in what a chunk brought."""
        self.state, self.progress, self.lost = chunk.state, chunk.progress, 0
        self.seconds += chunk.seconds
        if chunk.engine not in self.engines:
            self.engines.append(chunk.engine)

    def resume(self, run: Run, bed: RunState) -> None:
        """Go on where a runner before left the bed, if it kept all that the next step needs."""
        if (found := read_checkpoint(bed.archive)) is not None:
            self.state, self.progress = found, packing.progress(self.specimen, found)
            self.seconds, self.engines = run.seconds or 0.0, [f"{run.numba_version} {run.processor}"]

    def run(self, state: str) -> Run:
        """Return the row of its run; the error of an earlier try is over."""
        named = [engine.split(" ", 1) for engine in self.engines]
        return Run(
            specimen_hash=self.digest,
            specimen=self.specimen.canonical(packing.VERSION),
            engine_version=packing.VERSION,
            numba_version="+".join(dict.fromkeys(numba for numba, _ in named)) or None,
            processor="+".join(dict.fromkeys(processor for _, processor in named)) or None,
            seed=self.specimen.seed,
            spheres=self.specimen.spheres,
            state=state,
            seconds=self.seconds,
            error=None,
            finished_at=None if state == "running" else now(),
        )

    def done(self, chunk: Advanced) -> tuple[Run, RunState]:
        """Return the rows of a run that is done and of its bed."""
        assert chunk.result is not None
        run, result = self.run("done"), chunk.result
        run.packing_density = None if math.isnan(result.packing_density) else result.packing_density  # a heap's
        for name in MEASURES:
            setattr(run, name, getattr(result, name))
        run.slab_shares = json.dumps(result.slab_shares)
        run.warnings = "\n".join(result.warnings) or None
        return run, RunState(specimen_hash=self.digest, steps=result.steps, archive=chunk.archive)

    def failed(self, error: EngineError) -> tuple[Run, RunState | None]:
        """Return the rows of a run that failed and of its last bed, if there is one."""
        if error.engine and error.engine not in self.engines:
            self.engines.append(error.engine)
        run = self.run("failed")
        run.error = str(error)
        last = error.state if isinstance(error.state, packing.State) else self.state
        if last is None:
            return run, None
        return run, RunState(specimen_hash=self.digest, steps=last.steps, archive=where(last))

    def so_far(self) -> tuple[Run, RunState]:
        """Return the rows of a run that is under way and of its bed with all that the next step needs."""
        assert self.state is not None
        kept = RunState(specimen_hash=self.digest, steps=self.state.steps, archive=checkpoint(self.state))
        return self.run("running"), kept

    def text(self) -> str:
        """Return how far it is as a line of the log."""
        assert self.progress is not None
        left = self.seconds * (1.0 / max(self.share, 1e-3) - 1.0)
        return (
            f"bed {self.digest[:12]}, {self.specimen.spheres} spheres: {self.progress.steps} steps, kinetic energy "
            f"{self.progress.kinetic_energy:.1e} m g d, out of balance {self.progress.out_of_balance:.1e}, "
            f"{self.seconds:.0f} s, about {left:.0f} s left"
        )
