"""The tables and figures of docs/methods.md: what each method reaches, costs and errs on the shipped data.

``python tests/validation/methods.py`` (extra ``bench``) predicts Feret's pebbles and broken stone and the gradings of
2021 in ``methods.db`` in the current folder, where runs are kept, so that a run broken off carries on where it was, and
writes the tables between their marks in ``docs/methods.md`` and ``docs/methods_*.svg``. Some two hours on two cores.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pdlab import Lab, calibration, grading
from pdlab.batch.progress import Progress
from pdlab.calibration import GRADED, MONOSIZED, NODES, ROLLING, Ladder
from pdlab.experiments import Compared, PredictionReport, by_theory, summaries
from pdlab.experiments.assumptions import RULES
from pdlab.experiments.curves import Curves
from pdlab.specimen import on_grid

ROOT = Path(__file__).parents[2]
DOCS, DATA = ROOT / "docs", ROOT / "pdlab" / "data"
SETS = ("feret_pebbles", "feret_stone", "hindawi_2021", "von_schon")
GRADINGS, WIDE = "G2-8 + G1-1 7:3", ("G2-8", "G1-1", "CB-Mix-No.2", "Von Schon gravel")
"""A mixture of gradings of several classes, which nobody measured, and gradings whose diameters are shown."""
GRADED_ONE = "G2-8"
EVERYWHERE = ("auto", "drop_and_roll", "static", "ordered")
"""Methods that every measured mixture is predicted by."""


def markdown(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table."""
    lines = [list(columns), ["---"] * len(columns), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def number(value: float | None, digits: int = 4, sign: bool = False) -> str:
    """Return a number as text, nothing for None and NaN."""
    if value is None or np.isnan(value):
        return ""
    return f"{value:{'+' if sign else ''}.{digits}f}"


def ladders(lab: Lab) -> dict[str, Ladder]:
    """Return the beds whose curves are shown: equal spheres by both coefficients, one grading."""
    graded = next(one.grading for one in summaries(lab.store) if one.name == GRADED_ONE)
    assert graded is not None
    sizes = grading.sieve_classes(graded)
    reduced = tuple((on_grid(size / sizes[0][0]), on_grid(share)) for size, share in sizes)
    one = ((1.0, 1.0),)
    return {
        "`monosized`, μ": Ladder(MONOSIZED, one),
        "`monosized_rolling`, μ_r at μ = 1": Ladder(ROLLING, one),
        f"`graded`, μ, the grading of {GRADED_ONE}": Ladder(GRADED, reduced),
    }


def reach(lab: Lab) -> str:
    """Fill the curves, draw them, and return the table of what each method reaches and costs."""
    known, curves = ladders(lab), Curves(lab.store, lab.runner)
    curves.load(known.values())
    curves.extend({(ladder, node): calibration.SEEDS for ladder in known.values() for node in NODES})
    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    axes, rows = figure.add_subplot(), []
    for name, ladder in known.items():
        curve, runs = curves.known(ladder), curves.evidence(ladder)
        assert curve is not None
        values = [point.value for point in curve.points]
        densities = [point.mean for point in curve.points]
        axes.errorbar(values, densities, 2.0 * curve.node_errors(), fmt="o", label=name.replace("`", ""))
        fine = np.linspace(0.0, 1.0, 201) ** 2
        axes.plot(fine, [curve.at(value) for value in fine], color=axes.lines[-1].get_color())
        spheres = ladder.beds(NODES[0], 1)[0].spheres
        cost = np.array([run.steps for run in runs]) * spheres / 1e6
        errors = curve.node_errors()
        rows.append(
            [
                name, f"{densities[0]:.4f} ± {errors[0]:.4f}", f"{densities[-1]:.4f} ± {errors[-1]:.4f}",
                f"{spheres:,}", f"{np.median(cost):.0f} ({cost.min():.0f} to {cost.max():.0f})",
            ]
        )  # fmt: skip
    axes.set_xscale("symlog", linthresh=0.05)
    axes.set_xlabel("calibrated coefficient, μ or μ_r")
    axes.set_ylabel("packing density")
    axes.legend(fontsize=8)
    figure.savefig(DOCS / "methods_reach.svg", metadata={"Date": None})
    columns = ("method, coefficient", "PD at 0", "PD at 1", "spheres", "million sphere-steps a bed")
    return markdown(columns, rows)


def singles(lab: Lab) -> str:
    """Calibrate every aggregate by ``auto`` and return what it took."""
    rows = []
    for report in lab.calibrate(method="auto"):
        if report.result is None:
            rows.append([report.aggregate, number(report.measured), "none reaches it", "", "", str(report.error)])
            continue
        low = "0" if report.result.low is None else f"{report.result.low:.3g}"
        high = "or more" if report.result.high is None else f"to {report.result.high:.3g}"
        rows.append(
            [
                report.aggregate, number(report.measured), f"`{report.method}`",
                f"{report.friction:.4g}" if report.rolling == 0.0 else f"{report.friction:g}, μ_r {report.rolling:.4g}",
                f"{low} {high}", "",
            ]
        )  # fmt: skip
    return markdown(("aggregate", "measured PD", "taken", "μ", "its interval", ""), rows)


def mixtures(lab: Lab) -> dict[str, str]:
    """Predict every measured mixture by every method and return the tables of differences and of errors."""
    measured = list(dict.fromkeys(lab.predictions(["measured>0"], ["mixture"])["mixture"]))
    pebbles = [name for name in measured if name.startswith("pebbles")]
    lab.predict(pebbles)
    for method in EVERYWHERE:
        lab.predict(measured, method=method)
    out = {}
    for key, names in (("pebbles", pebbles), ("stone", [name for name in measured if name not in pebbles])):
        found = lab.compare_report(names)
        out[f"{key} differences"], out[f"{key} errors"] = differences(found), errors(found)
    return out


def differences(found: Compared) -> str:
    """Return every method's difference of every mixture."""
    methods = [method for method in found.outcomes if any(found.difference(method, name) for name in found.measured)]
    rows = [
        [name, number(value), *(number(found.difference(method, name), sign=True) for method in methods)]
        for name, value in found.measured.items()
    ]
    return markdown(("mixture", "measured", *methods), rows)


def errors(found: Compared) -> str:
    """Return the errors of every method with their intervals."""
    rows = []
    for one in found.over_own:
        bias, mean, square = (
            f"{number(figure.value, sign=figure is one.errors.bias)}"
            + ("" if figure.low is None else f" ({number(figure.low, 3)} to {number(figure.high, 3)})")
            for figure in (one.errors.bias, one.errors.mean_absolute, one.errors.root_mean_square)
        )
        worst = f"{number(one.errors.largest, sign=True)} ({one.worst})"
        rows.append([f"`{one.method}`", str(len(one.mixtures)), bias, mean, square, worst])
    return markdown(("method", "n", "bias", "mean absolute", "root mean square", "largest"), rows)


def rules(lab: Lab) -> str:
    """Return what each diameter rule makes of gradings of several classes, and of a mixture of two."""
    gradings = {one.name: one.grading for one in summaries(lab.store) if one.name in WIDE}
    frame = pd.DataFrame({"mixture": GRADINGS, "aggregate": ["G2-8", "G1-1"], "solid_volume_share": [0.7, 0.3]})
    lab.predict(frame, seeds=2)
    (sheet,) = lab.sheet([GRADINGS], seeds=2)
    simulated = {"log_mean": sheet.report} | {one.name: one.report for one in sheet.assumed if one.choice == RULES}
    rows = []
    for rule in grading.RULES:
        diameters = [grading.equivalent_diameters(one, [rule])[rule] for one in gradings.values() if one is not None]
        (theory,) = by_theory(lab.store, [GRADINGS], rule, ("toufar",))
        report = simulated[rule]
        cells = [f"`{rule}`", *(number(value, 3) for value in diameters)]
        rows.append([*cells, said(report), number(theory.values.get("toufar"))])
    others = [
        [f"{one.choice} {one.name}", *[""] * len(gradings), said(one.report), ""]
        for one in sheet.assumed
        if one.choice != RULES
    ]
    columns = ("", *(f"d of {name} [mm]" for name in gradings), f"PD of {GRADINGS}, simulated", "Toufar")
    return markdown(columns, [*rows, *others])


def said(report: PredictionReport) -> str:
    """Return a prediction with its standard error, or the beginning of why there is none."""
    if report.packing_density is None:
        return f"none: {report.message.split(';')[0]}"
    return f"{number(report.packing_density)} ± {number(report.standard_error)}"


def write(tables: dict[str, str]) -> None:
    """Put tables between their marks in docs/methods.md."""
    file = DOCS / "methods.md"
    text = file.read_text(encoding="utf-8")
    for name, table in tables.items():
        mark, end = f"<!-- table: {name} -->\n", "<!-- end -->"
        before, found, rest = text.partition(mark)
        if not found:
            raise SystemExit(f"{file} has no mark for the table '{name}'; add it")
        text = f"{before}{mark}\n{table}\n\n{end}{rest.partition(end)[2]}"
    file.write_text(text, encoding="utf-8")
    print(f"written to {file}: {', '.join(tables)}")


def main() -> None:
    """Make everything; each table is written as soon as it is there."""
    mpl.rcParams["svg.hashsalt"] = "pdlab"  # equal data, equal file
    with Lab("methods.db", progress=show) as lab:
        for name in SETS:
            lab.import_tables(DATA / name)
        write({"reach": reach(lab)})
        write({"singles": singles(lab)})
        write(mixtures(lab))
        write({"rules": rules(lab)})


def show(progress: Progress) -> None:
    """Say how far the beds are."""
    print(f"\r{progress.simulated} of {progress.wanted - progress.read} beds", end="", flush=True)


if __name__ == "__main__":
    main()
