"""What stands beside a sweep: measured mixtures, theory, what is outdated; a wish for one; its figures."""

from collections.abc import Sequence

import numpy as np
from conftest import FormulaRunner
from surfaces import normal

from pdlab.specimen import Packing, Specimen


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
