"""Figures from plain data."""

from pdlab.charts.beds import bed
from pdlab.charts.calibrations import calibration_curve
from pdlab.charts.gradings import grading_curve
from pdlab.charts.parity import parity
from pdlab.charts.proportions import proportion_triangle, share_curve, share_profiles

__all__ = [
    "bed",
    "calibration_curve",
    "grading_curve",
    "parity",
    "proportion_triangle",
    "share_curve",
    "share_profiles",
]
