"""Lattices and nested sizes: what spheres laid in order reach."""

import math

import numpy as np
import pytest

from pdlab.errors import ShareError
from pdlab.geometry import LATTICES, nested


@pytest.mark.parametrize(
    ("name", "basis"),
    [("sc", [(0, 0, 0)]), ("bcc", [(0, 0, 0), (1, 1, 1)]), ("fcc", [(0, 0, 0), (1, 1, 0), (1, 0, 1), (0, 1, 1)])],
)
def test_a_lattice_has_the_density_of_its_unit_cell(name: str, basis: list[tuple[int, int, int]]) -> None:
    cell = np.array(basis) / 2.0
    shifts = np.stack(np.meshgrid(*[(-1, 0, 1)] * 3), axis=-1).reshape(-1, 3)
    apart = np.linalg.norm((cell[None, :] - cell[:, None])[..., None, :] + shifts, axis=-1)
    radius = 0.5 * apart[apart > 0.0].min()
    assert len(basis) * 4.0 / 3.0 * math.pi * radius**3 == pytest.approx(LATTICES[name])


def test_hexagonal_layers_are_as_dense_as_cubic_ones() -> None:
    # two spheres in a prism on a rhomb of side d, two layers of √(2/3) d high
    assert 2.0 * math.pi / 6.0 / (math.sqrt(3.0) / 2.0 * 2.0 * math.sqrt(2.0 / 3.0)) == pytest.approx(LATTICES["hcp"])


def test_one_size_alone_has_its_own_density() -> None:
    assert nested([1.0]) == pytest.approx(0.7405, abs=5e-5)
    assert nested([1.0], 0.6) == pytest.approx(0.6)


def test_fines_first_fill_the_voids_and_then_carry_the_coarse() -> None:
    phi = 0.6
    assert nested([0.9, 0.1], phi) == pytest.approx(phi / 0.9)
    assert nested([0.3, 0.7], phi) == pytest.approx(1.0 / (0.3 + 0.7 / phi))


@pytest.mark.parametrize("sizes", [2, 3, 4])
def test_the_densest_shares_leave_the_voids_of_the_voids(sizes: int) -> None:
    phi = LATTICES["fcc"]
    shares = phi * (1.0 - phi) ** np.arange(sizes)  # each size fills its part of what the coarser leave
    shares /= shares.sum()
    best = nested(shares.tolist())
    assert best == pytest.approx(1.0 - (1.0 - phi) ** sizes)
    rng = np.random.default_rng(1)
    assert all(nested(other.tolist()) < best for other in rng.dirichlet(np.ones(sizes), 200))


def test_a_further_size_of_nearly_no_share_changes_nothing() -> None:
    assert nested([0.7, 0.3 - 1e-9, 1e-9]) == pytest.approx(nested([0.7, 0.3]), abs=1e-8)


def test_shares_that_are_none_are_refused() -> None:
    for shares in ([0.5, 0.6], [1.2, -0.2], []):
        with pytest.raises(ShareError):
            nested(shares)
