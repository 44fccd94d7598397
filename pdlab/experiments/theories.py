"""Theory: what the analytical packing models make of stored mixtures, from the current gradings and density tests."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from pdlab import grading, store, theory
from pdlab.errors import InputError, PdlabError, ProtocolError
from pdlab.experiments.readings import current_tests, measured_test, particle_density
from pdlab.grading import DEFAULT_RULE
from pdlab.models import Aggregate, Mixture
from pdlab.store import Store
from pdlab.theory import Material

BLOCK = 2000
"""Mixtures that are worked out at once: bounds the memory that shares of many aggregates take."""
VOLUME_MEAN = "volume_mean"
MODELS: Mapping[str, theory.Theory] = {VOLUME_MEAN: theory.volume_mean, **theory.THEORIES}
"""The theories, and the reference that is none."""


@dataclass(frozen=True)
class Theoretical:
    """A mixture's packing densities [-] by name of the theory, and the error that stands in the place of one."""

    mixture: str
    values: dict[str, float] = field(default_factory=dict)
    errors: dict[str, PdlabError] = field(default_factory=dict)


@dataclass(frozen=True)
class Recipe:
    """A mixture as the theories take it, or the error that stands in its place.

    ``shares`` of the solid volume, shape (S,), of its ``materials``. ``compaction``: that of its density test, of its
    aggregates' tests where it has none that states one, None where those differ; unstated is taken as loose.
    """

    mixture: str
    materials: tuple[Material, ...] = ()
    shares: tuple[float, ...] = ()
    compaction: str | None = None
    error: PdlabError | None = None


def by_theory(
    target: Store, names: Sequence[str] = (), rule: str = DEFAULT_RULE, wanted: Sequence[str] = tuple(theory.THEORIES)
) -> list[Theoretical]:
    """Return the packing densities of the named mixtures, or of all, by each of the ``wanted`` theories.

    ``rule``: for the equivalent diameter. The error of a mixture that has none by a theory stands in its place.
    Raises UnknownName, InputError for a theory that is absent or unknown.
    """
    for name in wanted:
        if name != VOLUME_MEAN:
            theory.theory(name)
    with target.read() as session:
        mixtures = store.mixtures(session, names)
        aggregates = store.aggregates_by_id(session, components_of(mixtures))
    return evaluate(recipes(mixtures, aggregates, rule), wanted)


def components_of(mixtures: Sequence[Mixture]) -> list[int]:
    """Return the ids of all aggregates in mixtures, each once."""
    return list(dict.fromkeys(part.aggregate_id for row in mixtures for part in row.components))


def recipes(mixtures: Sequence[Mixture], aggregates: Sequence[Aggregate], rule: str = DEFAULT_RULE) -> list[Recipe]:
    """Return stored mixtures of ``aggregates``, which come with their tests, as the theories take them.

    Raises GradingError for an unknown ``rule``; what is wrong with one mixture stands in its place.
    """
    grading.check_rule(rule)
    known = {row.id: _material(row, rule) for row in aggregates}
    return [_recipe(row, known) for row in mixtures]


def _material(row: Aggregate, rule: str) -> Material | PdlabError:
    """Return what the theories know of an aggregate, or why they cannot."""
    try:
        sieved, test = current_tests(row)
        sizes, shares = zip(*grading.sieve_classes(sieved), strict=True)
        return Material(
            grading.equivalent_diameter(sieved, rule),
            measured_test(test, particle_density(row)).packing_density,
            sizes,
            shares,
            _stated(test.compaction),
        )
    except PdlabError as error:
        return error


def _recipe(row: Mixture, known: Mapping[int, Material | PdlabError]) -> Recipe:
    materials, test = list[Material](), store.newest_test(row.packing_tests)
    stated = None if test is None or test.compaction == "unstated" else test.compaction
    for part in row.components:
        one = known[part.aggregate_id]
        if isinstance(one, PdlabError):
            return Recipe(row.name, compaction=stated, error=one)
        materials.append(one)
    shares = tuple(part.solid_volume_share for part in row.components)
    if stated is not None:
        return Recipe(row.name, tuple(materials), shares, stated)
    ways = {material.compaction for material in materials}
    return Recipe(row.name, tuple(materials), shares, ways.pop() if len(ways) == 1 else None)


def _stated(compaction: str) -> str:
    """Return the compaction of a density test; unstated is taken as loose, as it is simulated."""
    return "loose" if compaction == "unstated" else compaction


def evaluate(asked: Sequence[Recipe], wanted: Sequence[str] = tuple(theory.THEORIES)) -> list[Theoretical]:
    """Return the packing densities of mixtures by each of the ``wanted`` models, all mixtures at once."""
    out = [Theoretical(recipe.mixture) for recipe in asked]
    for name in wanted:
        groups, checked = dict[str | None, list[int]](), dict[object, PdlabError | None]()
        for k, recipe in enumerate(asked):
            key = (*map(id, recipe.materials), recipe.compaction)
            if recipe.error is None and key not in checked:
                checked[key] = _refusal(name, recipe)
            error = recipe.error or checked.get(key)
            if error is None:
                groups.setdefault(recipe.compaction, []).append(k)
            else:
                out[k].errors[name] = error
        for compaction, members in groups.items():
            members.sort(key=lambda k: tuple(map(id, asked[k].materials)))  # those of the same aggregates together
            for first in range(0, len(members), BLOCK):
                block = members[first : first + BLOCK]
                values = _of_block(name, [asked[k] for k in block], compaction)
                for k, value in zip(block, values.tolist(), strict=True):
                    out[k].values[name] = value
    return out


def over_shares(
    aggregates: Sequence[Aggregate], shares: theory.Floats, rule: str, wanted: Sequence[str]
) -> tuple[dict[str, theory.Floats], dict[str, PdlabError]]:
    """Return PD [-] over proportions of aggregates by each of the ``wanted`` theories, shape (M,), or why it has none.

    ``shares`` of the solid volume [-], shape (M, S), of the aggregates, which come with their tests.
    """
    found = [_material(row, rule) for row in aggregates]
    materials = tuple(one for one in found if isinstance(one, Material))
    for error in found:
        if isinstance(error, PdlabError):
            return {}, dict.fromkeys(wanted, error)
    ways = {material.compaction for material in materials}
    compaction = ways.pop() if len(ways) == 1 else None
    mixes = evaluate([Recipe("", materials, tuple(row), compaction) for row in shares.tolist()], wanted)
    values = {name: np.array([mix.values[name] for mix in mixes]) for name in wanted if name in mixes[0].values}
    return values, mixes[0].errors


def _refusal(name: str, recipe: Recipe) -> PdlabError | None:
    """Return why a model cannot tell a mixture's packing density, None where it can."""
    try:
        if name != "cpm":
            theory.check_compaction(name, recipe.materials, recipe.compaction)
        elif recipe.compaction is None:
            ways = sorted({material.compaction or "" for material in recipe.materials})
            raise ProtocolError(
                f"the aggregates were tested {' and '.join(ways)}, and cpm takes the mixture's own compaction; enter a "
                "density test of the mixture, or tests of the same kind"
            )
        else:
            for material in recipe.materials:
                theory.residual_packing(material, theory.compaction_index(recipe.compaction))
    except InputError as error:
        return error
    return None


def _of_block(name: str, block: Sequence[Recipe], compaction: str | None) -> theory.Floats:
    """Return the packing densities of mixtures by one model, shape (M,): each aggregate is a column of shares."""
    materials = {id(material): material for recipe in block for material in recipe.materials}
    columns = {key: k for k, key in enumerate(materials)}
    shares = np.zeros((len(block), len(columns)))
    rows = np.repeat(np.arange(len(block)), [len(recipe.shares) for recipe in block])
    places = np.array([columns[id(material)] for recipe in block for material in recipe.materials])
    np.add.at(shares, (rows, places), [share for recipe in block for share in recipe.shares])
    shares /= shares.sum(axis=1, keepdims=True)
    return MODELS[name](list(materials.values()), shares, compaction or "unstated")
