"""How far a call of the runner is."""

from dataclasses import dataclass

from pdlab import packing


@dataclass(frozen=True)
class Progress:
    """How far a call is: runs wanted, read from the store and simulated, and the share of work done.

    ``beds``: how far those are that run now. ``sphere_steps``: done since the call began.
    """

    wanted: int
    read: int
    simulated: int
    share: float
    beds: tuple[packing.Progress, ...] = ()
    sphere_steps: int = 0
