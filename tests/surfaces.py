"""Formula surfaces of packing density over proportions, and an engine that answers by them."""

import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pdlab import theory
from pdlab.errors import EngineError
from pdlab.mixture import Part, scatter
from pdlab.specimen import Packing, Specimen

Floats = NDArray[np.float64]
Truth = Callable[[Floats], Floats]
KINDS = ("middle", "bent", "flat", "end")


def shape(kind: str, number: int, aggregates: int = 2) -> tuple[list[Part], Truth]:
    """Return aggregates and a true PD over their shares (M, S), which departs from every theory by some 0.02."""
    rng = np.random.default_rng([number, aggregates])
    near, far = {"flat": (1.0, 1.3), "end": (1.05, 1.3)}.get(kind, (1.7, 3.5 if aggregates > 2 else 4.5))
    diameters = 10.0 / np.cumprod(np.concatenate([[1.0], rng.uniform(near, far, aggregates - 1)]))
    densities = rng.uniform(0.55, 0.64, aggregates)
    if kind == "flat":
        densities = 0.6 + rng.uniform(-0.005, 0.005, aggregates)
    materials = [theory.Material(float(d), float(pd)) for d, pd in zip(diameters, densities, strict=True)]
    scale, height, phase = rng.normal(1.0, 0.2), rng.normal(0.0, 0.02), rng.uniform(0.0, 6.0)

    def truth(shares: Floats) -> Floats:
        mean, bound = theory.volume_mean(materials, shares), theory.furnas(materials, shares)
        gain = theory.cpm(materials, shares, "loose") - mean
        if kind == "bent":
            gain = 0.6 * gain + 0.3 * (bound - mean)
        free = 1.0 - np.sum(shares**2, axis=1)  # none where an aggregate stands alone
        waves = np.sin(3.0 * shares @ np.arange(aggregates) + phase)
        return np.asarray(mean + scale * gain + (0.2 if kind == "flat" else 1.0) * height * free * waves)

    parts = [
        Part(f"a{k}", 1.0, ((material.diameter, 1.0),), round(0.1 + 0.01 * k, 2), material.packing_density, 0.005, 0.0)
        for k, material in enumerate(materials)
    ]
    return parts, truth


@dataclass
class Engine:
    """Answers by a true PD and a scatter by seed; ``fails``: shares → error or None.

    ``scatter``: standard deviation, by default as beds have it: that of as many equal spheres as bear.
    """

    parts: Sequence[Part]
    truth: Truth
    scatter: float | None = None
    fails: Callable[[Floats], EngineError | None] = lambda _: None
    asked: list[Specimen] = field(default_factory=list)

    def shares(self, bed: Specimen) -> Floats:
        """Return the shares of the aggregates in a bed, told by their friction."""
        by_friction = dict(zip((kind.friction for kind in bed.species), bed.shares, strict=True))
        return np.array([by_friction.get(part.friction, 0.0) for part in self.parts])

    def __call__(self, beds: Sequence[Specimen]) -> list[Packing | EngineError]:
        self.asked += beds
        return [self.fails(self.shares(bed)) or self.packing(bed) for bed in beds]

    def packing(self, bed: Specimen) -> Packing:
        digest, shares = bed.digest(3), self.shares(bed)
        value = float(self.truth(shares[None, :])[0])
        mix = [replace(part, share=share) for part, share in zip(self.parts, shares.tolist(), strict=True) if share > 0]
        value += (scatter(mix, bed, value) if self.scatter is None else self.scatter) * normal(digest)
        return Packing(digest, value, 5.0, 20.0, bed.shares, 0.005, "still", 1000, 1.0, 3)


def normal(text: str) -> float:
    """Return a standard normal number that belongs to a text."""
    one, other = (int(hashlib.sha256(text.encode()).hexdigest()[k : k + 8], 16) / 0xFFFFFFFF for k in (0, 8))
    return math.sqrt(-2.0 * math.log(max(one, 1e-12))) * math.cos(2.0 * math.pi * other)
