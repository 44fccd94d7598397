"""Laws of one contact: the bounce, the slope, the pair's momentum, the energy."""

import math
from dataclasses import replace

import numpy as np
import pytest

from pdlab.dem import bed, contact, measures, simulation
from pdlab.dem.bed import Setup, State


def make_setup(
    friction: float = 0.3,
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0),
    held: bool = False,
    restitution: float = 0.5,
    diameters: tuple[float, ...] = (1.0,),
) -> Setup:
    """Undamped spheres with 200 steps in a collision."""
    n = len(diameters)
    return Setup(
        diameter=np.array(diameters),
        density=np.ones(n),
        friction=np.full(n, friction),
        count=np.full(n, 100),
        width=10.0,
        seed=1,
        wall_friction=friction,
        restitution=restitution,
        local_damping=0.0,
        steps_per_collision=200.0,
        gravity=np.array(gravity),
        rotation_held=held,
    )


def spheres(setup: Setup, *places: tuple[float, float, float]) -> State:
    species = np.arange(len(places)) % setup.diameter.size
    place = np.column_stack([np.array(places), 0.5 * setup.diameter[species]])
    return bed.rest_free(place, species)


def test_damping_ratio_for_restitution_one_half_is_0_2553() -> None:
    assert contact.damping_ratio(0.5) == pytest.approx(0.2553, abs=5e-5)
    assert contact.damping_ratio(1.0) == 0.0


@pytest.mark.parametrize("restitution", [0.3, 0.5, 0.9])
def test_a_bounce_on_the_floor_returns_the_restitution(restitution: float) -> None:
    setup = make_setup(restitution=restitution)
    state = spheres(setup, (5.0, 5.0, 0.51))
    state.motion[0, 2] = -0.1
    after = simulation.march(setup, state, 2000)
    assert after.place[0, 2] > 0.5
    assert after.motion[0, 2] == pytest.approx(0.1 * restitution, rel=0.01)


@pytest.mark.parametrize("diameters", [(1.0, 1.0), (1.0, 0.4)])
def test_a_head_on_bounce_of_two_returns_the_restitution(diameters: tuple[float, float]) -> None:
    setup = make_setup(diameters=diameters)
    gap = 0.5 * sum(diameters) + 0.01
    state = spheres(setup, (5.0, 5.0, 5.0), (5.0 + gap, 5.0, 5.0))
    state.motion[0, 0], state.motion[1, 0] = 0.1, -0.05
    after = simulation.march(setup, state, 8000)
    assert after.motion[1, 0] - after.motion[0, 0] == pytest.approx(0.5 * 0.15, rel=0.01)


def test_momentum_and_its_moment_of_a_free_pair_are_conserved() -> None:
    setup = make_setup(friction=0.2, diameters=(1.0, 0.5))
    state = spheres(setup, (5.0, 5.0, 5.0), (5.76, 5.1, 5.05))
    state.motion[0, :3], state.motion[0, 4:7] = (0.2, 0.05, -0.1), (0.3, -1.0, 0.7)
    state.motion[1, :3] = (-0.3, 0.1, 0.02)
    after = simulation.march(setup, state, 3000)
    assert np.abs(after.motion[0, :3] - state.motion[0, :3]).max() > 0.01  # they did meet
    mass = setup.body[state.species, 0][:, None]
    np.testing.assert_allclose((mass * after.motion[:, :3]).sum(0), (mass * state.motion[:, :3]).sum(0), atol=1e-14)

    def moment(now: State) -> np.ndarray:
        spin = now.motion[:, 4:7] / setup.body[now.species, 1][:, None]
        return np.asarray((mass * np.cross(now.place[:, :3], now.motion[:, :3]) + spin).sum(0))

    # the lever is the radius, not the radius less half the overlap, hence the tolerance
    np.testing.assert_allclose(moment(after), moment(state), atol=2e-3)


def slope(tangent: float) -> tuple[float, float, float]:
    angle = math.atan(tangent)
    return math.sin(angle), 0.0, -math.cos(angle)


def settled_on_slope(setup: Setup) -> State:
    """A sphere that lies in the floor as deep as its weight presses it."""
    depth = -setup.gravity[2] * setup.mass[0] / setup.laws[1][0, contact.KN]
    return spheres(setup, (5.0, 5.0, 0.5 - float(depth)))


@pytest.mark.parametrize("friction", [0.2, 0.5])
def test_a_sphere_that_cannot_rotate_slides_above_tan_phi_equal_mu(friction: float) -> None:
    for factor, slides in ((0.95, False), (1.05, True)):
        setup = make_setup(friction, slope(factor * friction), held=True)
        after = simulation.march(setup, settled_on_slope(setup), 20_000)
        time = after.steps * setup.time_step
        wanted = (setup.gravity[0] + friction * setup.gravity[2]) * time if slides else 0.0
        assert after.motion[0, 0] == pytest.approx(wanted, abs=0.02 * setup.gravity[0] * time)


def test_a_free_sphere_rolls_at_once_and_slips_above_tan_phi_equal_seven_halves_mu() -> None:
    for factor, slips in ((0.95, False), (1.05, True)):
        setup = make_setup(0.1, slope(factor * 0.35))
        after = simulation.march(setup, settled_on_slope(setup), 20_000)
        speed, spin = after.motion[0, 0], 0.5 * after.motion[0, 5]
        time = after.steps * setup.time_step
        if slips:
            assert speed == pytest.approx((setup.gravity[0] + 0.1 * setup.gravity[2]) * time, rel=0.01)
            assert spin < 0.98 * speed
        else:
            assert speed == pytest.approx(5.0 / 7.0 * setup.gravity[0] * time, rel=0.01)
            assert spin == pytest.approx(speed, rel=0.01)


def energy(setup: Setup, state: State) -> float:
    """Kinetic, potential and elastic energy, springs of slip included."""
    from pdlab.dem import integrator

    total = float(integrator.kinetic_energy(state.motion, state.species, setup.body))
    total -= float((setup.body[state.species, 0] * (state.place[:, :3] @ setup.gravity)).sum())
    pair, floor = setup.laws
    i, j, delta = measures.contacts(setup, state)
    total += 0.5 * float((pair[state.species[i], state.species[j], contact.KN] * delta**2).sum())
    pressed = np.maximum(state.place[:, 3] - state.place[:, 2], 0.0)
    total += 0.5 * float((floor[state.species, contact.KN] * pressed**2).sum())
    # a tangential spring holds its force F, and so the energy F²/(2 k_t)
    slip = state.pairs.spring.reshape(-1, 3, 8).transpose(0, 2, 1).reshape(-1, 3)
    kn = pair[state.species[state.pairs.owner], state.species[state.pairs.neighbor], contact.KN]
    total += 0.5 * float(((slip**2).sum(1) / (contact.TANGENTIAL_STIFFNESS * kn)).sum())
    kn = np.repeat(floor[state.species, contact.KN], np.diff(state.near.first))
    return total + 0.5 * float(((state.near.spring**2).sum(1) / (contact.TANGENTIAL_STIFFNESS * kn)).sum())


def test_energy_never_grows_in_a_falling_bed_without_local_damping() -> None:
    setup = Setup(
        np.array([1.0, 0.6]), np.ones(2), np.array([0.3, 0.5]), np.array([30, 60]), 5.0, 3, 0.3,
        local_damping=0.0, steps_per_collision=100.0,
    )  # fmt: skip
    state = bed.start(setup)
    values = [energy(setup, state)]
    for _ in range(60):
        state = simulation.march(setup, state, 500)
        values.append(energy(setup, state))
    scale = values[0]
    assert values[-1] < 0.7 * scale
    assert np.diff(values).max() < 1e-3 * scale


def test_a_normal_force_never_pulls() -> None:
    out = contact.contact_force(0.001, 0.0, 0.0, 1.0, 0.0, 0.0, 5.0, 0.0, 0.0, 0.0, 100.0, 10.0, 0.3, 1e-3)
    assert out[0] == 0.0
    assert out[1:4] == (0.0, 0.0, 0.0)


def test_a_pair_has_springs_in_series_and_the_smaller_friction_and_so_has_the_floor() -> None:
    diameter, mass = np.array([1.0, 0.25]), np.array([0.5, 0.01])
    pair, floor = contact.law_tables(diameter, mass, np.array([0.2, 0.6]), np.array([0.3, 0.1]), 0.4, 100.0, 0.25)
    np.testing.assert_allclose(floor[:, contact.KN], 2.0 * 100.0 * diameter)
    assert pair[0, 1, contact.KN] == pytest.approx(2.0 * 100.0 * 1.0 * 0.25 / 1.25)
    assert pair[0, 1, contact.GN] == pytest.approx(2.0 * 0.25 * math.sqrt(40.0 * 0.5 * 0.01 / 0.51))
    np.testing.assert_allclose(pair[..., contact.ROLLING], [[0.3, 0.1], [0.1, 0.1]])
    np.testing.assert_allclose(floor[:, contact.ROLLING], 0.0)
    np.testing.assert_allclose(pair[..., contact.MU], [[0.2, 0.2], [0.2, 0.6]])
    np.testing.assert_allclose(floor[:, contact.MU], [0.2, 0.4])
    np.testing.assert_allclose(pair, pair.swapaxes(0, 1))


@pytest.mark.parametrize(("rule", "wanted"), [("minimum", 0.2), ("mean", 0.5), ("geometric_mean", 0.4)])
def test_the_friction_of_a_pair_is_the_minimum_or_a_mean_of_theirs(rule: str, wanted: float) -> None:
    one, friction = np.ones(2), np.array([0.2, 0.8])
    pair, floor = contact.law_tables(one, one, friction, np.zeros(2), 0.4, 100.0, 0.25, rule)
    np.testing.assert_allclose(pair[..., contact.MU], [[0.2, wanted], [wanted, 0.8]])
    np.testing.assert_allclose(floor[:, contact.MU], [0.2, 0.4])


@pytest.mark.parametrize(("velocity", "wanted"), [(-0.01, -0.3), (1.0, -1.7)])
def test_local_damping_takes_its_share_of_the_resultant_against_the_velocity(velocity: float, wanted: float) -> None:
    setup = replace(make_setup(gravity=(0.0, 0.0, -1.0)), local_damping=0.7)
    state = spheres(setup, (5.0, 5.0, 9.0))
    state.motion[0, 2] = velocity
    after = simulation.march(setup, state, 1000)
    assert (after.motion[0, 2] - velocity) / (1000 * setup.time_step) == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize("rolling", [0.05, 0.2])
def test_two_pressed_spheres_resist_rolling_up_to_their_limit(rolling: float) -> None:
    # an elastic-plastic spring: the moment grows as k_r θ, to μ_r R_eff F_n, then stays
    fn, kn, reff, dt, speed = 2.0, 500.0, 0.25, 1e-4, 0.3
    stiffness, limit = 2.25 * kn * rolling**2 * reff**2, rolling * reff * fn
    moment, turned = (0.0, 0.0, 0.0), 0.0
    for _ in range(2000):
        moment = contact.rolling_moment(fn, 0.0, 0.0, 1.0, speed, 0.0, 5.0, *moment, kn, rolling, reff, dt)
        turned += speed * dt
        assert moment[0] == pytest.approx(-min(stiffness * turned, limit), rel=1e-9)
        assert moment[1:] == (0.0, 0.0)  # twisting meets nothing
    back = contact.rolling_moment(fn, 0.0, 0.0, 1.0, -speed, 0.0, 0.0, *moment, kn, rolling, reff, dt)
    assert back[0] == pytest.approx(moment[0] + stiffness * speed * dt, rel=1e-9)


def test_rolling_resistance_stops_relative_spin_and_keeps_the_moment_of_momentum() -> None:
    setup = replace(make_setup(0.5, restitution=0.5), rolling=np.array([0.3]))
    free = replace(setup, rolling=None)
    for one, resists in ((setup, True), (free, False)):
        state = spheres(one, (5.0, 5.0, 5.0), (5.0, 5.0, 5.999))
        state.motion[0, 4], state.motion[1, 4] = 0.5, -0.5  # rolling on each other, no sliding
        state.motion[:, 2] = (0.05, -0.05)
        after = simulation.march(one, state, 100)
        gone = 1.0 - (after.motion[0, 4] - after.motion[1, 4])
        assert (gone > 1e-3) == resists
        assert after.motion[0, 4] + after.motion[1, 4] == pytest.approx(0.0, abs=1e-12)


def test_a_wall_does_not_resist_rolling() -> None:
    setup = replace(make_setup(0.1, slope(0.95 * 0.35)), rolling=np.array([0.5]))
    after = simulation.march(setup, settled_on_slope(setup), 20_000)
    time = after.steps * setup.time_step
    assert after.motion[0, 0] == pytest.approx(5.0 / 7.0 * setup.gravity[0] * time, rel=0.01)


def test_the_side_of_a_cylinder_bounces_and_rubs_like_the_floor() -> None:
    setup = replace(make_setup(0.2, restitution=0.5), cylinder=True, width=6.0)
    centre = 0.5 * setup.box
    angle = 0.7
    outward = np.array([math.cos(angle), math.sin(angle), 0.0])
    state = spheres(setup, tuple(np.array([centre, centre, 5.0]) + 2.49 * outward))  # type: ignore[arg-type]
    state.motion[0, :3] = 0.1 * outward + np.array([0.0, 0.0, 0.1])
    after = simulation.march(setup, state, 3000)
    assert after.motion[0, :3] @ outward == pytest.approx(-0.05, rel=0.01)
    assert after.motion[0, 2] < 0.0999  # rubbed along the wall
    assert np.linalg.norm(after.place[0, :2] - centre) < 2.5


@pytest.mark.parametrize(("damped", "wanted"), [(False, 1.0), (True, 0.3)])
def test_moments_are_damped_only_when_that_is_asked_for(damped: bool, wanted: float) -> None:
    # a sphere at rest on a slope begins to roll: its spin is driven by the floor's friction alone
    base = make_setup(0.001, slope(0.35))  # slips, so that the torque is that of sliding friction
    for setup in (base, replace(base, local_damping=0.7, moment_damping=damped)):
        state = settled_on_slope(setup)
        after = simulation.march(setup, state, 2000)
        torque = after.load[0, 5]
        spin = after.motion[0, 5] / (2000 * setup.time_step * setup.body[0, 1] * torque)
        assert spin == pytest.approx(1.0 if setup is base else wanted, rel=0.03)
