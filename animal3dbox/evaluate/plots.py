"""Plots of the tables, by matplotlib, which the extra "plots" installs."""

import importlib.util
import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from animal3dbox.evaluate.answers import records_of
from animal3dbox.evaluate.tables import Table

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
    """A plot as PNG for each table that has one; None without matplotlib.

    A table in which nothing is known that could be drawn has none.
    """
    if not has_matplotlib():
        return None
    plotters = {
        "stability": _stability,
        "accuracy": _accuracy,
        "pose": _pose,
        "reproduction": _reproduction,
        "faces": _faces,
        "dataset": _dataset,
        "foreign": _foreign,
        "curve": _curve,
    }
    figures = {
        table.name: plotters[table.name](records)
        for table in tables
        if table.name in plotters and (records := records_of(table))
    }
    return {name: png_of(figure) for name, figure in figures.items() if figure is not None}


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


def _dataset(records: list[dict[str, Any]]) -> "Figure | None":
    """A panel a measure, without those that are unknown, or zero, for all methods."""
    measures = {
        "annotated median px": ("keypoints off by, px: median, line to 95 %", "annotated p95 px"),
        "mask IoU median": ("overlap with the mask: median, line to 5 %", "mask IoU p5"),
        "rotation median deg": ("turned against the true box, degrees: median", None),
        "IoU3D median": ("overlap with the true box: median", None),
        "rejected %": ("animals without a label, %", None),
    }
    panel_words = {
        name: words for name, words in measures.items() if any(r.get(name) for r in records)
    }
    if not panel_words:
        return None
    figure, panels = new_figure(
        12, 2.6 * ((len(panel_words) + 1) // 2), (len(panel_words) + 1) // 2, 2
    )
    for panel, (measure, (words, end)) in zip(panels, panel_words.items(), strict=False):
        _rows(panel, records, "method", measure, end=end)
        panel.set_title(words, fontsize=9, loc="left")
    for panel in panels[len(panel_words) :]:
        panel.remove()
    return figure


def _foreign(records: list[dict[str, Any]]) -> "Figure | None":
    if not any(r.get("rotation median deg") for r in records):
        return None
    figure, panels = new_figure(12, 0.8 + 0.3 * len(records))
    _rows(panels[0], records, "setting", "rotation median deg", end="p95 deg")
    panels[0].set_title("turned against the true box, degrees: median, line to 95 %", fontsize=9)
    return figure


def _curve(records: list[dict[str, Any]]) -> "Figure":
    figure, panels = new_figure(5.5, 5)
    panels[0].plot((0, 1), (0, 1), color="black", linestyle=":", linewidth=1, label="as told")
    for marker, labels in zip("os", dict.fromkeys(r["labels"] for r in records), strict=False):
        points = [(r["told"], r["true"]) for r in records if r["labels"] == labels]
        panels[0].plot(*zip(*points, strict=True), marker=marker, label=labels)
    panels[0].set(xlabel="confidence that is told", ylabel="part of labels that are right")
    panels[0].legend(fontsize=8)
    return figure


def _rows(
    panel: "Axes", records: list[dict[str, Any]], name: str, measure: str, *, end: str | None
) -> None:
    """A bar a record, the first above, its value beside it, and a line to another measure."""
    measured = [record for record in records if record.get(measure) is not None]
    for place, record in enumerate(measured):
        value = record[measure]
        far = record.get(end) if end is not None else None
        panel.barh(place, value, height=0.6, color="tab:blue", alpha=0.75)
        if far is not None:
            panel.plot((value, far), (place, place), color="black", linewidth=1, marker="|")
        panel.annotate(
            f"{value:.3g}",
            (max(value, far or 0.0), place),
            xytext=(6, 0),
            textcoords="offset points",
            va="center",
            fontsize=8,
        )
    panel.set_yticks(range(len(measured)), [str(record[name]) for record in measured], fontsize=8)
    panel.invert_yaxis()
    panel.margins(x=0.12, y=0.02)
    panel.set_xlim(left=0)


def _bars(panel: "Axes", records: list[dict[str, Any]], name: str, groups: Sequence[str]) -> None:
    """Groups of bars, one a record in each group; what is unknown has none.

    A panel without any height says so, lest it looks as if it was forgotten.
    """
    width = 0.8 / max(len(records), 1)
    for number, record in enumerate(records):
        numbers = [i for i, group in enumerate(groups) if record.get(group) is not None]
        places = [i + (number - (len(records) - 1) / 2) * width for i in numbers]
        panel.bar(places, [record[groups[i]] for i in numbers], width, label=record[name])
    values = [record[g] for record in records for g in groups if record.get(g) is not None]
    if not any(values):
        words = "0 for all of them" if values else "not known"
        panel.text(0.5, 0.5, words, transform=panel.transAxes, ha="center")
    panel.set_xticks(range(len(groups)), list(groups), fontsize=8)
    panel.legend(fontsize=7)
