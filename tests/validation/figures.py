"""The figures of docs/validation.md, drawn from the tables beside it.

``python tests/validation/figures.py`` reads ``docs/friction_table.md`` and ``docs/protocols.md`` and
writes ``docs/validation_*.svg``. It needs the extra ``bench``.
"""

from collections.abc import Iterator
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

DOCS = Path(__file__).parents[2] / "docs"
LITERATURE = Path(__file__).parents[2] / "pdlab" / "data" / "physics_reference.csv"
SHOWN = (
    ("Agnolin & Roux 2007", "PD random close packing, monosized frictionless", 0.0),
    ("Agnolin & Roux 2007", "PD isotropically compressed, monosized", 0.3),
    ("Jerkins et al. 2008, PRL 101 018301", "PD random loose packing", 1.0),
)
"""Source, quantity and friction of the literature's values in the first figure."""
REFERENCE = 5
"""Column of the reference PD; another of this name holds contacts."""


def tables(file: str) -> Iterator[pd.DataFrame]:
    """Give the tables of a Markdown file, numbers as numbers; "± …" and remarks in brackets left out."""
    rows: list[list[str]] = []
    for line in [*(DOCS / file).read_text(encoding="utf-8").splitlines(), ""]:
        if line.startswith("|"):
            rows.append([cell.strip() for cell in line.strip("|").split("|")])
        elif rows:
            frame = pd.DataFrame(rows[2:], columns=pd.Index([f"{k} {name}" for k, name in enumerate(rows[0])]))
            yield frame.apply(_numbers).rename(columns=lambda name: name.split(" ", 1)[1])
            rows = []


def _numbers(column: "pd.Series[str]") -> "pd.Series[float]":
    plain = column.str.replace(r"\s*(±.*|\(.*\)|%)$", "", regex=True)
    numbers = pd.to_numeric(plain, errors="coerce")
    return column if numbers.isna().all() else numbers


def friction(axes: Axes) -> None:
    """PD over friction, with and without local damping, beside other programs and the literature."""
    table = next(tables("friction_table.md"))
    plain = table[table["μ_r"] == 0.0]
    for alpha, colour in ((0.7, "C0"), (0.0, "C1")):
        rows = plain[plain["α"] == alpha]
        axes.errorbar(
            rows["μ"], rows["PD"], 2.0 * rows["standard error"], fmt="o-", color=colour, label=f"pdlab, α = {alpha:g}"
        )
        axes.plot(rows["μ"], rows.iloc[:, REFERENCE], "x", color=colour, label=f"independent program, α = {alpha:g}")
    second = plain[plain["second"].notna()]
    axes.plot(second["μ"], second["second"], "+", color="C2", label="second program, α = 0.7")
    read = pd.read_csv(LITERATURE)
    for source, quantity, mu in SHOWN:
        value = read[(read["source"] == source) & (read["quantity"] == quantity)]["value"]
        axes.plot([mu], [float(value.iloc[0])], "k*", markersize=10)
        axes.annotate(
            source.split(",")[0],
            (mu, float(value.iloc[0])),
            textcoords="offset points",
            xytext=(-6, 7),
            ha="right" if mu else "left",
        )
    axes.set_xscale("symlog", linthresh=0.05)
    axes.set_xlabel("friction coefficient μ")
    axes.set_ylabel("packing density")
    axes.legend(fontsize=8)


def containers(axes: Axes) -> None:
    """PD of a cylinder over its diameter, beside the periodic bed."""
    table = next(frame for frame in tables("protocols.md") if "container" in frame)
    wide = table.columns[1]
    rows = table[(table["container"] == "cylinder") & (table["wall μ"] == 0.3)]
    axes.errorbar(
        1.0 / rows[wide], rows["PD"], 2.0 * rows["standard error"], fmt="o-", label="cylinder, as high as wide"
    )
    periodic = table[(table["container"] == "periodic") & (table["spheres"] == 2500)]["PD"].iloc[0]
    axes.axhline(periodic, linestyle="--", color="C1", label="periodic, no walls")
    axes.set_xlabel("d / container diameter")
    axes.set_ylabel("packing density")
    axes.set_xlim(left=0.0)
    axes.legend(fontsize=8)


def binaries(axes: Axes) -> None:
    """PD of two sizes over the coarse share, and the limit of an infinite ratio."""
    table = next(frame for frame in tables("protocols.md") if "coarse share" in frame)
    for ratio, rows in table.groupby("size ratio"):
        axes.errorbar(
            rows["coarse share"], rows["PD"], 2.0 * rows["standard error"], fmt="o-", label=f"size ratio {ratio:g}"
        )
    alone = next(frame for frame in tables("protocols.md") if "container" in frame)
    density = alone[(alone["container"] == "periodic") & (alone["spheres"] == 2500)]["PD"].iloc[0]
    share = np.linspace(0.0, 1.0, 201)
    fine_fills = density / np.maximum(share, 1e-9)
    coarse_swims = 1.0 / (share + (1.0 - share) / density)
    axes.plot(share, np.minimum(fine_fills, coarse_swims), "k--", label="infinite ratio (Furnas)")
    axes.set_xlabel("coarse share of the solid volume")
    axes.set_ylabel("packing density")
    axes.legend(fontsize=8)


def main() -> None:
    """Draw and write every figure."""
    mpl.rcParams["svg.hashsalt"] = "pdlab"  # equal data, equal file
    for name, draw in (("friction", friction), ("container", containers), ("binaries", binaries)):
        figure = Figure(figsize=(7.0, 4.2), layout="constrained")
        draw(figure.add_subplot())
        file = DOCS / f"validation_{name}.svg"
        figure.savefig(file, metadata={"Date": None})
        print(f"written to {file}")


if __name__ == "__main__":
    main()
