"""The rough floor at z = 0 and the laterally periodic sides."""

from pdlab.dem.contact import contact_force
from pdlab.dem.jit import kernel


@kernel
def add_floor_loads(place, motion, species, law, spring, dt, load):  # type: ignore[no-untyped-def]
    """Add what the floor does to each sphere to ``load``; return the contacts and their Σ F_n.

    Arrays as in ``contact.add_pair_loads``; ``law`` (S, 5), ``spring`` (N, 3), zero where nothing
    touches. The floor is rigid and still.
    """
    contacts, total = 0, 0.0
    for i in range(place.shape[0]):
        r = place[i, 3]
        delta = r - place[i, 2]
        if delta <= 0.0:
            spring[i, 0] = spring[i, 1] = spring[i, 2] = 0.0
            continue
        a = species[i]
        fn, fx, fy, fz, sx, sy, sz = contact_force(
            delta, 0.0, 0.0, 1.0,
            motion[i, 0] - r * motion[i, 5], motion[i, 1] + r * motion[i, 4], motion[i, 2],
            spring[i, 0], spring[i, 1], spring[i, 2],
            law[a, 0], law[a, 1], law[a, 2], law[a, 3], law[a, 4], dt,
        )  # fmt: skip
        spring[i, 0], spring[i, 1], spring[i, 2] = sx, sy, sz
        load[i, 0] += fx
        load[i, 1] += fy
        load[i, 2] += fn + fz
        load[i, 4] += r * fy
        load[i, 5] -= r * fx
        contacts, total = contacts + 1, total + fn
    return contacts, total


@kernel
def wrap(place, width):  # type: ignore[no-untyped-def]
    """Bring every sphere's x and y back into [0, width)."""
    for i in range(place.shape[0]):
        for axis in range(2):
            while place[i, axis] < 0.0:
                place[i, axis] += width
            while place[i, axis] >= width:
                place[i, axis] -= width
