"""Fixtures: a store in memory by real migrations, and an engine that answers by a formula."""

import hashlib
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest
import sqlalchemy as sa

from pdlab.dem import VERSION
from pdlab.experiments import register
from pdlab.lab import SHIPPED
from pdlab.specimen import Packing, Specimen
from pdlab.store import Store, open_store
from pdlab.tables import read_path


@pytest.fixture(scope="session")
def memory() -> Iterator[sa.Connection]:
    opened = open_store("sqlite://")
    assert isinstance(opened.writer, sa.Engine)
    with opened.writer.connect() as connection:
        yield connection
    opened.close()


@pytest.fixture
def store(memory: sa.Connection) -> Iterator[Store]:
    """A store in memory; what a test writes is rolled back after it."""
    outer = memory.begin()
    yield Store("sqlite://", memory, memory)
    outer.rollback()


@pytest.fixture
def pebbles(store: Store) -> Store:
    register(store, read_path(SHIPPED))
    return store


def formula_density(friction: float) -> float:
    """A falling PD(μ) between 0.64 and 0.55, near to what spheres do."""
    return 0.55 + 0.09 * math.exp(-3.0 * math.sqrt(friction))


def formula_packing(specimen: Specimen, noise: float = 0.002, version: int = VERSION) -> Packing:
    digest = specimen.digest(version)
    scatter = int(hashlib.sha256(digest.encode()).hexdigest()[:8], 16) / 0xFFFFFFFF - 0.5
    friction = min(kind.friction for kind in specimen.species)
    gain = 0.05 * (1.0 - specimen.species[-1].diameter)
    value = formula_density(friction) + gain + noise * scatter
    return Packing(digest, value, 5.0, 20.0, specimen.shares, 0.005, "still", 1000, 1.0, version)


class FormulaRunner:
    """Stands for the runner in tests of rooms that run nothing; keeps runs as rows like it."""

    def __init__(self, target: Store, version: int = VERSION) -> None:
        self.target, self.engine_version, self.asked = target, version, list[str]()

    def close(self) -> None:
        """End nothing: no process was started."""

    def __call__(self, specimens: Sequence[Specimen]) -> list[Packing]:
        from pdlab.models import Run

        out = [formula_packing(specimen, version=self.engine_version) for specimen in specimens]
        with self.target.write() as session:
            for specimen, packing in zip(specimens, out, strict=True):
                self.asked.append(packing.digest)
                session.merge(
                    Run(
                        specimen_hash=packing.digest,
                        specimen=specimen.canonical(self.engine_version),
                        engine_version=self.engine_version,
                        seed=specimen.seed,
                        spheres=specimen.spheres,
                        state="done",
                        packing_density=packing.packing_density,
                    )
                )
        return out


@pytest.fixture
def formula_runner() -> Callable[[Store], FormulaRunner]:
    return FormulaRunner


@pytest.fixture
def folder(tmp_path: Path) -> Callable[..., Path]:
    """Write tables into a folder, by file name without its ending."""

    def write(**files: str) -> Path:
        for name, text in files.items():
            (tmp_path / f"{name}.csv").write_text(text, encoding="utf-8")
        return tmp_path

    return write
