"""Packing density over all proportions of several aggregates, as a Gaussian process that beds are told to.

Shares stand on a grid over the simplex; the process is a mean, shape (M,), and a covariance, shape (M, M), in PD. This
module plans and runs nothing.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

STEPS = {2: 100, 3: 40, 4: 20, 5: 10}
"""Steps from one aggregate alone to another on the grid, by the number of aggregates."""
DEVIATIONS = (0.004, 0.01, 0.025)
"""How far simulation and theory may be apart, as standard deviations in PD [-]."""
LENGTHS = (0.25, 0.5, 1.0)
"""Distances of shares over which that difference may change [-]; two aggregates alone are √2 apart."""
SMOOTHNESS = 2.5
"""ν of the Matérn kernel: twice differentiable, as a curve with a bend but no corner is."""
ROUNDING = 1e-5
"""Error in PD [-] that is added to every value and draw, so that covariances can be decomposed."""
NEGLIGIBLE = 0.01
"""Weight, of the largest, below which a process is left out of the average."""
DRAWS = 512
DRAWN_BY = 1
"""The seed by which the process is drawn from: the same beds are asked for again."""
TIE = 9
"""Digits of what a bed would tell; what differs by less is equal, and the first on the grid is taken."""


def share_grid(aggregates: int) -> Floats:
    """Return all proportions on the grid, shape (M, S), each row summing to 1."""
    steps = STEPS[aggregates]
    cuts = itertools.combinations(range(steps + aggregates - 1), aggregates - 1)
    bars = np.array([(-1, *cut, steps + aggregates - 1) for cut in cuts])
    return np.asarray((np.diff(bars, axis=1) - 1)[::-1] / steps, dtype=np.float64)


def vertices(shares: Floats) -> list[int]:
    """Return where each aggregate stands alone on the grid."""
    return [int(np.argmax(shares[:, k])) for k in range(shares.shape[1])]


@dataclass(frozen=True)
class Surface:
    """What is believed of PD over a grid of ``shares`` (M, S): its ``mean`` (M,) and ``covariance`` (M, M) [-]."""

    shares: Floats
    mean: Floats
    covariance: Floats

    @property
    def deviation(self) -> Floats:
        """The standard deviation of PD at each place, shape (M,)."""
        return np.sqrt(np.diag(self.covariance))

    def told(self, at: int, error: float, value: float | None = None) -> "Surface":
        """Return the surface after one more value of PD of this standard error; without it the mean stays."""
        column = self.covariance[:, at]
        weight = column / (column[at] + error**2)
        mean = self.mean if value is None else self.mean + weight * (value - self.mean[at])
        return Surface(self.shares, mean, self.covariance - np.outer(weight, column))

    def with_more(self, covariance: Floats) -> "Surface":
        """Return the surface with the covariance of further errors, shape (M, M)."""
        return Surface(self.shares, self.mean, self.covariance + covariance)

    def draws(self, allowed: NDArray[np.intp]) -> Floats:
        """Return PDs drawn at the allowed places together, shape (512, A), always the same."""
        from threadpoolctl import threadpool_limits

        among = self.covariance[np.ix_(allowed, allowed)] + ROUNDING**2 * np.eye(allowed.size)
        normal = np.random.default_rng(DRAWN_BY).standard_normal((DRAWS, allowed.size))
        with threadpool_limits(1):
            return np.asarray(self.mean[allowed] + normal @ np.linalg.cholesky(among).T, dtype=np.float64)

    def densest_chances(self, allowed: NDArray[np.intp]) -> Floats:
        """Return the probability of each place to be the densest of those allowed, shape (M,)."""
        best = allowed[np.argmax(self.draws(allowed), axis=1)]
        return np.bincount(best, minlength=self.mean.size) / DRAWS

    def telling(self, chances: Floats, error: Floats | float) -> Floats:
        """Return how much a value of PD of this error at each place tells of the densest, of the most, shape (M,).

        By how much it lowers the variances of all places, weighed by their ``chances`` to be the densest, shape (M,).
        """
        drop = chances @ self.covariance**2 / (np.diag(self.covariance) + np.square(error) + ROUNDING**2)
        return np.asarray(np.round(drop / max(float(drop.max()), ROUNDING**4), TIE), dtype=np.float64)


def fitted(
    shares: Floats, theories: Sequence[Floats], at: Sequence[int], values: Sequence[float], errors: Sequence[float]
) -> Surface:
    """Return the surface through PDs [-] of mixtures at places of the grid, each with its standard error.

    ``theories``: PD over the grid by packing models, each of shape (M,) and right for each aggregate alone. From them
    simulation departs by a Gaussian process with a Matérn kernel, not at all where an aggregate stands alone. Nothing
    is fitted but averaged over: each theory with each of DEVIATIONS and LENGTHS counts by the likelihood that it gives
    to the mixtures.
    """
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import ConstantKernel, Matern
    from threadpoolctl import threadpool_limits

    alone = vertices(shares)
    noise = np.concatenate([np.zeros(len(alone)), np.asarray(errors) ** 2]) + ROUNDING**2
    processes, likelihoods = list[tuple[Floats, Any]](), list[float]()
    with threadpool_limits(1):  # the same to the last bit on any number of cores
        for deviation, length in itertools.product(DEVIATIONS, LENGTHS):
            kernel = ConstantKernel(deviation**2) * Matern(length, nu=SMOOTHNESS)
            ends = np.linalg.slogdet(kernel(shares[alone]) + ROUNDING**2 * np.eye(len(alone)))[1] / 2.0
            for theory in theories:
                apart = np.concatenate([np.zeros(len(alone)), np.asarray(values) - theory[list(at)]])
                process = GaussianProcessRegressor(kernel, alpha=noise, optimizer=None)
                process.fit(shares[[*alone, *at]], apart)
                processes.append((theory, process))
                likelihoods.append(process.log_marginal_likelihood_value_ + ends)
        return _averaged(shares, processes, np.exp(np.array(likelihoods) - max(likelihoods)))


def _averaged(shares: Floats, processes: Sequence[tuple[Floats, Any]], weights: Floats) -> Surface:
    """Return the mean and covariance of processes that count by their weights; what hardly counts is left out."""
    counting = weights >= NEGLIGIBLE
    weights = weights[counting] / weights[counting].sum()
    found = list[tuple[Floats, Floats]]()
    for (theory, one), counts in zip(processes, counting, strict=True):
        if counts:
            apart, around = one.predict(shares, return_cov=True)
            found.append((theory + apart, around))
    mean = np.asarray(weights @ np.array([its for its, _ in found]), dtype=np.float64)
    covariance = np.zeros((mean.size, mean.size))
    for weight, (its, around) in zip(weights, found, strict=True):
        covariance += weight * (around + np.outer(its - mean, its - mean))
    return Surface(shares, mean, covariance)


def pinned(shares: Floats, deviation: float, length: float) -> Floats:
    """Return the covariance of an error that is none where an aggregate stands alone, shape (M, M).

    ``deviation`` in PD [-]; ``length``: shares over which it changes.
    """
    from sklearn.gaussian_process.kernels import Matern

    free = Surface(shares, np.zeros(len(shares)), deviation**2 * np.asarray(Matern(length, nu=SMOOTHNESS)(shares)))
    for at in vertices(shares):
        free = free.told(at, ROUNDING)
    return free.covariance
