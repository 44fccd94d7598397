"""Angles of repose and of slip → the measured angle and its error, the friction of the walls."""

import math
from dataclasses import dataclass

from pdlab.errors import AngleError

DEFAULT_ERROR = 1.0
"""Standard error of a measured angle of repose [degrees]: the tables hold none."""
STEEPEST_SLIP = 84.0
"""Slip angle [degrees] above which it is a typing error: a friction of 9.5."""


@dataclass(frozen=True)
class MeasuredAngle:
    """A measured angle of repose and its standard error [degrees], and what was assumed on the way."""

    value: float
    standard_error: float
    warnings: tuple[str, ...] = ()


def measured_angle(angle: float) -> MeasuredAngle:
    """Return a measured angle of repose [degrees] with the error that is assumed of it. Raises AngleError."""
    if not 0.0 < angle < 90.0:
        raise AngleError(f"an angle of repose of {angle:g} degrees lies outside (0, 90); correct repose_angle_deg")
    note = f"no error of the angle of repose is known: a standard error of {DEFAULT_ERROR:g} degree is assumed"
    return MeasuredAngle(angle, DEFAULT_ERROR, (note,))


def wall_friction(slip_angle: float) -> float:
    """Return the friction of a wall [-], the tangent of its ``slip_angle`` [degrees]. Raises AngleError.

    The angle to which a plate of the wall's material is tilted before grains that are held from rolling slide.
    """
    if not 0.0 <= slip_angle <= STEEPEST_SLIP:
        raise AngleError(
            f"a slip angle of {slip_angle:g} degrees lies outside [0, {STEEPEST_SLIP:g}]; correct wall_angle_deg"
        )
    return math.tan(math.radians(slip_angle))
