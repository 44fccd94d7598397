"""Beds in three dimensions."""

import numpy as np
import plotly.graph_objects as go
from scipy.spatial import ConvexHull

from pdlab.charts.style import GRID, LINES, Drawn, made, shown
from pdlab.experiments import DrawnBed

CORNERS = 42
"""Corners of a ball that is drawn."""
LABELS = 6
"""So many on the longest axis, fewer on the others, where they would overlap."""


def bed(drawn: DrawnBed) -> go.Figure:
    """Return a bed's spheres in three dimensions, coloured by aggregate, lengths in mm with one scale for all axes."""
    series, (points, faces) = list[Drawn](), _ball()
    centre, radius = drawn.place[:, :3], drawn.place[:, 3:]
    for k, name in enumerate(drawn.names):
        own = drawn.part == k
        corners = centre[own, None] + radius[own, None] * points
        meshed = faces + len(points) * np.arange(own.sum())[:, None, None]
        x, y, z = corners.reshape(-1, 3).T.astype(np.float32)
        i, j, of = meshed.reshape(-1, 3).T.astype(np.int32)
        series.append({
            "type": "mesh3d", "x": x, "y": y, "z": z, "i": i, "j": j, "k": of, "name": shown(name),
            "color": LINES[k % len(LINES)], "showlegend": True, "hoverinfo": "name",
            "lighting": {"ambient": 0.45, "diffuse": 0.7, "specular": 0.1},
            "lightposition": {"x": -1000, "y": -3000, "z": 3000},
        })  # fmt: skip
    low, high = (centre - radius).min(axis=0), (centre + radius).max(axis=0)
    part = (high - low) / (high - low).max()
    axes = {
        f"{axis}axis": {"title": f"{axis} [mm]", "gridcolor": GRID, "range": [float(low[n]), float(high[n])],
                        "nticks": 2 + round(LABELS * float(part[n]))}
        for n, axis in enumerate("xyz")
    }  # fmt: skip
    ratio = {axis: float(part[n]) for n, axis in enumerate("xyz")}
    camera = {"eye": {"x": 0.45, "y": -1.35, "z": 0.35}}
    scene = {"aspectmode": "manual", "aspectratio": ratio, "camera": camera, **axes}
    return made(series, 680, showlegend=True, legend={"orientation": "h"}, scene=scene)


def _ball() -> tuple[np.ndarray, np.ndarray]:
    """Return corners of a unit ball, shape (42, 3), evenly by the golden angle, and its triangles, all seen outside."""
    number = np.arange(CORNERS)
    height, angle = 1.0 - (2.0 * number + 1.0) / CORNERS, number * np.pi * (3.0 - np.sqrt(5.0))
    across = np.sqrt(1.0 - height**2)
    points = np.stack([across * np.cos(angle), across * np.sin(angle), height], axis=1)
    faces = ConvexHull(points).simplices
    a, b, c = (points[faces[:, n]] for n in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a) < 0.0
    faces[inward] = faces[inward][:, ::-1]
    return points, faces
