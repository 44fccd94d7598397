"""Figures hold what they were given."""

import base64
import re
from xml.etree import ElementTree

import numpy as np
import pytest

from pdlab import charts
from pdlab.charts.parity import CROWDED
from pdlab.experiments import Density, DrawnBed, Points
from pdlab.grading import ASTM_C33_FINE, SieveRow, SieveTable, combined, make_grading


def test_a_grading_curve_has_the_sieves_as_ticks_on_a_log_axis() -> None:
    rows = (SieveRow(16.0, 0.0), SieveRow(8.0, 30.0), SieveRow(4.0, 70.0))
    figure = charts.grading_curve({"<b>A</b>": make_grading(SieveTable(rows, "retained_g"))})
    assert figure.layout.xaxis.type == "log"
    assert list(figure.layout.xaxis.ticktext) == ["4", "8", "16"]
    assert [round(value, 9) for value in figure.data[0].y] == [100.0, 70.0, 0.0]
    assert "<b>" not in figure.data[0].hovertemplate + figure.data[0].name


def test_targets_and_limits_stand_behind_the_gradings() -> None:
    sand = make_grading(SieveTable((SieveRow(4.75, 0.0), SieveRow(2.36, 50.0), SieveRow(1.18, 50.0)), "retained_g"))
    figure = charts.grading_curve({"S": sand}, {"Fuller": ([1.18, 4.75], [0.5, 1.0])}, ASTM_C33_FINE)
    band, target, line = figure.data
    assert (band.fill, target.line.dash, line.mode) == ("toself", "dash", "lines+markers")
    assert [float(value) for value in target.y] == [50.0, 100.0]
    assert max(band.x) == 9.5
    assert list(figure.layout.xaxis.tickvals) == [1.18, 2.36, 4.75]


def test_sieves_too_near_to_be_labelled_are_drawn_without_a_tick() -> None:
    near = make_grading(SieveTable((SieveRow(16.0, 0.0), SieveRow(15.9, 50.0), SieveRow(8.0, 50.0)), "retained_g"))
    figure = charts.grading_curve({"S": near})
    assert list(figure.layout.xaxis.tickvals) == [8.0, 15.9]
    assert len(figure.data[0].x) == 3


def points(method: tuple[str, ...], current: tuple[bool, ...]) -> Points:
    place = np.arange(len(method))
    return Points(
        7 + place, tuple(f"<b>{k}" for k in place), method, np.array(current), 0.66 - 0.01 * place,
        np.full(place.size, 0.012), 0.65 + 0.0 * place, np.where(place == 1, np.nan, 0.005),
    )  # fmt: skip


def test_a_parity_chart_has_both_errors_one_range_and_the_bands() -> None:
    figure = charts.parity(points(("graded",), (True,)))
    drawn = figure.data[-1]
    assert (list(drawn.x), list(drawn.y)) == ([0.65], [0.66])
    assert (list(drawn.error_x.array), list(drawn.error_y.array)) == ([0.005], [0.012])
    assert figure.layout.xaxis.range == figure.layout.yaxis.range
    assert figure.layout.yaxis.range[1] > 0.66 + 0.012
    wide, narrow, line = figure.data[:3]
    for band, half in ((wide, 0.02), (narrow, 0.01), (line, 0.0)):
        off = np.array(band.y) - np.array(band.x)
        assert {round(abs(value), 9) for value in off} == {half}


def test_a_parity_chart_tells_methods_and_outdated_predictions_apart() -> None:
    two = points(("graded", "auto", "graded"), (True, True, False))
    graded, outdated, auto = charts.parity(two, methods=("graded", "auto")).data[3:]
    assert [one.name for one in (graded, auto, outdated)] == ["graded", "auto", "graded, outdated"]
    assert graded.marker.color == outdated.marker.color != auto.marker.color
    assert outdated.marker.symbol == graded.marker.symbol + "-open"
    assert [list(one.customdata) for one in (graded, auto, outdated)] == [[[7]], [[8]], [[9]]]
    assert auto.text[0] == "&lt;b>1<br>by auto<br>measured 0.6500<br>predicted 0.6500 ± 0.0120"
    alone = charts.parity(points(("auto",), (True,)), methods=("graded", "auto")).data[-1]
    assert (alone.marker.color, alone.marker.symbol) == (auto.marker.color, auto.marker.symbol)


def test_what_is_picked_in_a_parity_chart_stands_out() -> None:
    three = points(("graded",) * 3, (True,) * 3)
    assert charts.parity(three).data[-1].selectedpoints is None
    assert list(charts.parity(three, picked=(8, 40)).data[-1].selectedpoints) == [1]


def test_many_points_are_one_picture_of_dots_and_bars_where_the_axes_say() -> None:
    count = CROWDED
    many = points(("A",) * count, (True,) * (count - 10) + (False,) * 10)
    few = charts.parity(points(("A",) * (count - 1), (True,) * (count - 1))).layout
    assert (few.images, few.legend.itemclick) == ((), None)
    figure = charts.parity(many, picked=(8, 40))
    (picture,) = figure.layout.images
    ends = np.array(figure.layout.xaxis.range)
    assert (picture.x, picture.y) == tuple(ends)
    assert (picture.sizex, picture.sizey) == (pytest.approx(np.diff(ends)[0]),) * 2
    svg = ElementTree.fromstring(base64.b64decode(picture.source.split(",", 1)[1]))
    side = float(svg.attrib["viewBox"].split()[2])
    found = dict[str, list[str]]()
    for path in svg.iterfind("{*}path"):
        found.setdefault(path.attrib["stroke-width"], []).append(path.attrib["d"])
    assert [len(re.findall("h0", path)) for path in found["7"]] == [count - 12, 2]  # pale ones first, picked on top
    assert [len(re.findall("h0", path)) for path in found["4"]] == [10, 0]
    numbers = [[float(text) for text in re.findall(r"[-\d.]+", "".join(paths))] for paths in found.values()]
    crosses = np.array(numbers[0]).reshape(-1, 6) / side * np.diff(ends)
    middles = np.stack([crosses[:, 0] + crosses[:, 2] / 2.0, np.diff(ends) - crosses[:, 1]], axis=1) + ends[0]
    where = np.argsort(-middles[:, 1])
    assert middles[where] == pytest.approx(np.stack([many.measured, many.predicted], axis=1), abs=1e-4)
    for lengths, errors in ((crosses[:, 2], many.measured_error), (crosses[:, 5], many.expected_error)):
        assert lengths[where] == pytest.approx(2.0 * np.nan_to_num(errors), abs=1e-4)
    assert "vector-effect:non-scaling-stroke" in svg.findtext("{*}style", ""), "dots are round on any screen"
    legend = figure.layout.legend
    assert legend.itemclick is legend.itemdoubleclick is False, "the picture does not change with it"
    assert all(series.marker.maxdisplayed == 1 and series.error_x.array is None for series in figure.data[3:])


def test_a_density_has_a_square_for_each_cell_coloured_by_the_logarithm_of_its_number() -> None:
    cells = Density(np.array([130, 131, 128]), np.array([131, 131, 120]), np.array([1, 100, 0]), np.array([5, 0, 4]))
    outdated, current, *edges = charts.parity(points((), ()), cells).data[3:]
    assert sorted(round(edge.y[0] - edge.x[0], 9) for edge in edges) == [-0.02, -0.01, 0.0, 0.01, 0.02]
    assert (list(current.x), list(current.y)) == ([130.5 * 0.005, 131.5 * 0.005], [131.5 * 0.005] * 2)
    assert list(current.marker.color) == [0.0, 2.0]
    assert list(current.customdata) == [[130, 131, 1], [131, 131, 1]]
    assert list(current.text) == ["1 prediction", "100 predictions"]
    assert list(outdated.customdata) == [[128, 120, 1]]
    ends = charts.parity(points((), ()), cells).layout.xaxis.range
    assert ends[0] < 120 * 0.005
    assert ends[1] > 132 * 0.005


def test_a_mixture_s_grading_is_thick_and_its_parts_are_thin() -> None:
    coarse = make_grading(SieveTable((SieveRow(16.0, 0.0), SieveRow(4.0, 100.0)), "retained_g"))
    fine = make_grading(SieveTable((SieveRow(4.0, 0.0), SieveRow(1.0, 100.0)), "retained_g"))
    mixed = combined([coarse, fine], [0.5, 0.5])
    lines = charts.grading_curve({"C": coarse, "F": fine}, mixture=mixed).data
    assert [line.name for line in lines] == ["C", "F", "mixture"]
    assert lines[2].line.width > 2.0 * max(lines[0].line.width, lines[1].line.width)
    assert [float(value) for value in lines[2].y] == [100.0, 50.0, 0.0]


def test_a_bed_has_a_colour_for_each_aggregate_and_one_scale_for_all_axes() -> None:
    place = np.array([[5.0, 5.0, 5.0, 5.0], [15.0, 5.0, 2.0, 2.0], [5.0, 15.0, 2.0, 2.0]])
    figure = charts.bed(DrawnBed(place, np.array([0, 1, 1]), ("<i>C", "F"), 3, "ab", 1))
    coarse, fine = figure.data
    assert (coarse.name, fine.name) == ("&lt;i>C", "F")
    assert coarse.color != fine.color
    corners = np.stack([fine.x, fine.y, fine.z], axis=1).reshape(2, -1, 3)
    assert np.allclose(np.linalg.norm(corners - place[1:, None, :3], axis=2), 2.0, atol=1e-5)
    scene = figure.layout.scene
    sides = {axis: np.ptp(scene[f"{axis}axis"].range) for axis in "xyz"}
    assert sides == {"x": 17.0, "y": 17.0, "z": 10.0}
    assert scene.aspectratio.z / scene.aspectratio.x == pytest.approx(sides["z"] / sides["x"])
    assert scene.zaxis.nticks < scene.xaxis.nticks == scene.yaxis.nticks, "labels stand apart on a short axis too"


def test_every_triangle_of_a_ball_is_seen_from_outside_and_they_close_it() -> None:
    place = np.array([[0.0, 0.0, 0.0, 1.0], [5.0, 0.0, 0.0, 1.0]])
    (mesh,) = charts.bed(DrawnBed(place, np.array([0, 0]), ("C",), 2, "ab", 1)).data
    corners = np.stack([mesh.x, mesh.y, mesh.z], axis=1).astype(float)
    a, b, c = (corners[index] for index in (mesh.i, mesh.j, mesh.k))
    centre = np.where(a[:, :1] > 2.0, place[1, :3], place[0, :3])
    volumes = np.einsum("ij,ij->i", np.cross(b - a, c - a), a - centre) / 6.0
    assert (volumes > 0.0).all()
    assert 0.85 < volumes.sum() / (2.0 * 4.0 / 3.0 * np.pi) < 1.0
