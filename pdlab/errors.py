"""Every error that pdlab raises on purpose: one sentence with the value, the limit and the remedy.

PdlabError
├── InputError              what the user can mend; the shell answers with exit code 2
│   ├── GradingError        a sieve table that is no grading
│   ├── DensityError        a bulk density, voids or packing density that cannot be one
│   ├── AngleError          an angle of repose or of slip that cannot be one, or is missing
│   ├── ShareError          proportions that are none
│   ├── ConditionError      a condition, a column or an order that a list does not have
│   ├── UnknownName         an aggregate, mixture or run that the store does not hold
│   ├── TableError          what is wrong in imported tables, all of it, with file, row, column
│   ├── ProtocolError       a test that this version cannot simulate, or two that do not mix
│   ├── OutOfReach          a packing density, or an angle, that the method's spheres cannot reach
│   ├── TooFewData          fewer measurements than what is to be fitted to them
│   ├── SpecimenTooLarge    a mixture that needs more spheres than the cap
│   ├── EditedMeanwhile     a row that another has changed since it was read
│   ├── StillNeeded         a row that cannot be deleted, since others rest on it
│   ├── DamagedRow          a row of the store that is not as pdlab wrote it
│   ├── SignInError         a sign-in that is not configured where it must be, or wrongly
│   └── StoreError          what is no store, a store of another revision, or a database that cannot be used now
│       └── StoreAway       a database that does not answer now and may later: locked, restarting, out of reach
├── ClaimLost               a wish that was cancelled, or that another runner has taken over
├── MigrationFailed         a store that could not be brought to a newer revision and is as it was
└── EngineError             a run that gave no packing density
    ├── RunDiverged         NaN, spheres that escape, a measure that is not filled
    ├── TooSoft             an overlap above the bound: contacts too soft for the forces in this bed
    ├── NotAtRest           the bed did not come to rest in its time
    ├── Segregated          the slab's shares are not the mixture's
    └── WorkersLost         worker processes died again and again, or a cluster has no scheduler or no worker
"""

from dataclasses import dataclass


class PdlabError(Exception):
    """Whatever pdlab raises on purpose."""


class InputError(PdlabError):
    """What the user can mend."""


class GradingError(InputError):
    """A sieve table that is no grading; ``row`` counts from 0, None for the table as a whole."""

    def __init__(self, message: str, row: int | None = None) -> None:
        super().__init__(message)
        self.row = row


class DensityError(InputError):
    """A bulk density, voids or packing density that cannot be one."""


class AngleError(InputError):
    """An angle of repose or of slip that cannot be one, or is missing."""


class ShareError(InputError):
    """Proportions that are none."""


class ConditionError(InputError):
    """A condition, a column or an order that a list does not have."""


class UnknownName(InputError):
    """An aggregate, mixture or run that the store does not hold."""


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong in a table: where, and what to do about it."""

    file: str
    row: int | None
    column: str | None
    message: str

    def __str__(self) -> str:
        place = self.file
        if self.row is not None:
            place += f", row {self.row}"
        if self.column is not None:
            place += f", column {self.column}"
        return f"{place}: {self.message}"


class TableError(InputError):
    """All that is wrong in imported tables; ``problems`` holds each with file, row and column."""

    def __init__(self, problems: list[Problem]) -> None:
        super().__init__("\n".join(str(problem) for problem in problems))
        self.problems = problems


class ProtocolError(InputError):
    """A test that this version cannot simulate, or two that do not mix."""


class OutOfReach(InputError):
    """A packing density, or an angle, that the method's spheres cannot reach.

    ``looser`` than all of them, or steeper; else denser, or flatter.
    """

    def __init__(self, message: str, looser: bool = False) -> None:
        super().__init__(message)
        self.looser = looser


class TooFewData(InputError):
    """Fewer measurements than what is to be fitted to them."""


class SpecimenTooLarge(InputError):
    """A mixture that needs more spheres than the cap."""


class EditedMeanwhile(InputError):
    """A row that another has changed since it was read."""


class StillNeeded(InputError):
    """A row that cannot be deleted, since others rest on it."""


class DamagedRow(InputError):
    """A row of the store that is not as pdlab wrote it."""


class SignInError(InputError):
    """A sign-in that is not configured where it must be, or wrongly."""


class StoreError(InputError):
    """What is no store, a store of another revision, or a database that cannot be used now."""


class StoreAway(StoreError):
    """A database that does not answer now and may later: locked, restarting, out of reach."""


class ClaimLost(PdlabError):
    """A wish that was cancelled, or that another runner has taken over."""


class MigrationFailed(PdlabError):
    """A store that could not be brought to a newer revision and is as it was."""


class EngineError(PdlabError):
    """A run that gave no packing density; ``state``: its last bed, for inspection, where there is one.

    ``engine``: by which numba and processor, where that was told.
    """

    engine = ""

    def __init__(self, message: str, state: object = None) -> None:
        super().__init__(message)
        self.state = state


class RunDiverged(EngineError):
    """NaN, spheres that escape, a measure that is not filled."""


class TooSoft(EngineError):
    """An overlap above the bound: contacts too soft for the forces in this bed."""


class NotAtRest(EngineError):
    """The bed did not come to rest in its time."""


class Segregated(EngineError):
    """The slab's shares are not the mixture's."""


class WorkersLost(EngineError):
    """Worker processes died again and again, or a cluster has no scheduler or no worker."""
