"""The packing density over friction and rolling friction."""

import itertools

import numpy as np
import pytest
from conftest import formula_density

from pdlab import equal_spheres
from pdlab.calibration import NODES
from pdlab.equal_spheres import Surface
from pdlab.errors import InputError


def density(friction: float, rolling: float) -> float:
    return formula_density(friction) - 0.1 * friction**0.5 * rolling / (0.2 + rolling)


def made(noise: float = 0.0, seeds: int = 2) -> Surface:
    scatter = np.random.default_rng(1).normal(0.0, noise, (len(NODES), len(NODES), seeds))
    pairs = itertools.product(enumerate(NODES), enumerate(NODES))
    return equal_spheres.through({(mu, mu_r): density(mu, mu_r) + scatter[j, k] for (j, mu), (k, mu_r) in pairs})


def test_a_surface_goes_through_its_nodes() -> None:
    for mu, mu_r in itertools.product(NODES, NODES):
        assert made().at(mu, mu_r)[0] == pytest.approx(density(mu, mu_r), abs=1e-12)


def test_between_its_nodes_a_smooth_law_is_met_and_what_the_interpolation_may_be_off_is_told() -> None:
    for mu, mu_r in itertools.product((0.01, 0.07, 0.4, 0.7), repeat=2):
        value, error = made().at(mu, mu_r)
        assert value == pytest.approx(density(mu, mu_r), abs=0.001)
        assert 1e-4 < error < 0.002


def test_the_error_at_a_node_is_the_pooled_deviation_over_the_root_of_its_seeds() -> None:
    found = made(0.002, 8)
    assert found.at(0.1, 0.1)[1] == pytest.approx(0.002 / 8**0.5, rel=0.1)
    more = equal_spheres.through(
        {(0.5, 0.0): [0.60, 0.602], (0.5, 0.5): [0.5, 0.5], (1.0, 0.0): [0.55] * 4, (1.0, 0.5): [0.4]}
    )
    pooled = (0.001**2 * 2 / 5) ** 0.5
    assert more.errors == pytest.approx(pooled / np.sqrt([[2.0, 2.0], [4.0, 1.0]]))


@pytest.mark.parametrize("place", [(-0.1, 0.2), (1.1, 0.2), (0.3, 1.5)])
def test_nothing_is_told_outside_the_grid(place: tuple[float, float]) -> None:
    with pytest.raises(InputError, match=r"lies outside \[0, 1\]"):
        made().at(*place)


def test_a_grid_with_a_hole_is_refused_with_the_pair() -> None:
    some = {(mu, mu_r): [density(mu, mu_r)] for mu in (0.2, 1.0) for mu_r in (0.0, 0.2)}
    del some[1.0, 0.2]
    with pytest.raises(InputError, match=r"no bed was run at \[\(1\.0, 0\.2\)\]"):
        equal_spheres.through(some)
