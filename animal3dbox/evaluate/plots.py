"""Plots of the tables, by matplotlib, which the extra "plots" installs."""

import importlib.util
import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from animal3dbox.evaluate.tables import PAPER, Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DPI = 110
LEAST_DEG = 1e-3
"""Below this an angle is drawn as this on a logarithmic axis."""


def has_matplotlib() -> bool:
    """Whether plots can be made."""
    return importlib.util.find_spec("matplotlib") is not None


def plots_of(tables: Sequence[Table]) -> dict[str, bytes] | None:
    """A plot as PNG for each table that has one; None without matplotlib."""
    if not has_matplotlib():
        return None
    known = {
        "stability": _stability,
        "accuracy": _accuracy,
        "pose": _pose,
        "reproduction": _reproduction,
        "faces": _faces,
        "dataset": _dataset,
    }
    return {
        table.name: png_of(known[table.name](_computed(table)))
        for table in tables
        if table.name in known
    }


def new_figure(
    width: float, height: float, rows: int = 1, columns: int = 1
) -> tuple["Figure", list["Axes"]]:
    """A figure of a size in inches, without any global state, and its axes."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, list(figure.subplots(rows, columns, squeeze=False).ravel())


def png_of(figure: "Figure") -> bytes:
    """A figure as PNG."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI)
    return buffer.getvalue()


def _computed(table: Table) -> list[dict[str, Any]]:
    """A table's records without the paper's published ones."""
    return [
        record
        for record in table.records()
        if not any(isinstance(v, str) and PAPER in v for v in record.values())
    ]


def _stability(records: list[dict[str, Any]]) -> "Figure":
    protocols = list(dict.fromkeys(r["protocol"] for r in records))
    figure, panels = new_figure(12, 3.6, 1, max(len(protocols), 1))
    sigmas = [
        float(c.removeprefix("sigma "))
        for c in (records[0] if records else {})
        if c.startswith("sigma ")
    ]
    for panel, protocol in zip(panels, protocols, strict=False):
        for number, record in enumerate(r for r in records if r["protocol"] == protocol):
            angles = [max(record[f"sigma {s:g}"] or 0.0, LEAST_DEG) for s in sigmas]
            panel.plot(sigmas, angles, marker="osD^v"[number % 5], label=record["rule"], alpha=0.8)
        panel.axhline(120.68, color="tab:red", linestyle=":", linewidth=1)
        panel.axhline(0.0046, color="tab:green", linestyle=":", linewidth=1)
        panel.set(
            title=protocol,
            yscale="log",
            ylim=(LEAST_DEG / 1.5, 300),
            xlabel="model units" if protocol == "model units" else "sigma px",
        )
    panels[0].set_ylabel("mean rotation, degrees")
    panels[-1].legend(
        fontsize=7, title="dotted: the paper's figures", title_fontsize=7, loc="lower right"
    )
    return figure


def _accuracy(records: list[dict[str, Any]]) -> "Figure":
    figure, panels = new_figure(12, 4.2)
    _bars(
        panels[0],
        records,
        "rule",
        [
            c
            for c in (records[0] if records else {})
            if c not in ("rule", "animals", "p95 deg", "IoU3D median")
        ],
    )
    panels[0].set(yscale="log", ylabel="median angle to the true trunk, degrees")
    panels[0].legend(fontsize=7, loc="upper left", bbox_to_anchor=(1, 1))
    return figure


def _pose(records: list[dict[str, Any]]) -> "Figure":
    figure, panels = new_figure(12, 8.5, 2, 2)
    measures = ("annotated mean px", "clean median px", "rotation median deg", "IoU3D median")
    settings, methods = (
        list(dict.fromkeys(r["setting"] for r in records)),
        list(dict.fromkeys(r["method"] for r in records)),
    )
    for panel, measure in zip(panels, measures, strict=True):
        table = [
            {"method": m, **{r["setting"]: r[measure] for r in records if r["method"] == m}}
            for m in methods
        ]
        _bars(panel, table, "method", settings)
        panel.set(ylabel=measure, **({} if measure.startswith("IoU") else {"yscale": "symlog"}))
        panel.set_xticks(panel.get_xticks(), settings, rotation=40, ha="right", fontsize=7)
    return figure


def _reproduction(records: list[dict[str, Any]]) -> "Figure":
    figure, panels = new_figure(12, 3.6, 1, 2)
    parts, methods = (
        list(dict.fromkeys(r["keypoints"] for r in records)),
        list(dict.fromkeys(r["method"] for r in records)),
    )
    for panel, measure, published in zip(
        panels, ("mean px", "degenerate %"), (75.28, 13.81), strict=True
    ):
        _bars(
            panel,
            [
                {"method": m, **{r["keypoints"]: r[measure] for r in records if r["method"] == m}}
                for m in methods
            ],
            "method",
            parts,
        )
        panel.axhline(published, color="black", linestyle=":", linewidth=1)
        panel.set(ylabel=f"{measure} (dotted: the paper's basic)")
    return figure


def _faces(records: list[dict[str, Any]]) -> "Figure":
    figure, panels = new_figure(12, 3.2, 1, 2)
    for panel, measures in zip(
        panels,
        (("in-frame share mean error", "in-frame share max error"), ("box to surface mean",)),
        strict=True,
    ):
        _bars(
            panel,
            [{"measure": m, **{r["view"]: r[m] for r in records}} for m in measures],
            "measure",
            [r["view"] for r in records],
        )
    panels[0].axhline(0.01, color="black", linestyle=":", linewidth=1)
    panels[0].set(yscale="log", ylabel="share (dotted: allowed)")
    panels[1].set(ylabel="share")
    return figure


def _dataset(records: list[dict[str, Any]]) -> "Figure":
    figure, panels = new_figure(12, 3.2, 1, 3)
    for panel, measure in zip(
        panels, ("annotated median px", "mask IoU median", "rejected %"), strict=True
    ):
        _bars(
            panel,
            [{"measure": measure, **{r["method"]: r[measure] for r in records}}],
            "measure",
            [r["method"] for r in records],
        )
    return figure


def _bars(panel: "Axes", records: list[dict[str, Any]], name: str, groups: Sequence[str]) -> None:
    """Groups of bars, one a record in each group; what is unknown has none."""
    width = 0.8 / max(len(records), 1)
    for number, record in enumerate(records):
        places = [i + (number - (len(records) - 1) / 2) * width for i in range(len(groups))]
        panel.bar(places, [record.get(group) or 0.0 for group in groups], width, label=record[name])
    panel.set_xticks(range(len(groups)), list(groups), fontsize=8)
    panel.legend(fontsize=7)
