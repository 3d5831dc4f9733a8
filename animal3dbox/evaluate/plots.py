"""Plots of the tables, by matplotlib, which the extra "plots" installs."""

import importlib.util
import io
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from animal3dbox.evaluate.answers import records_of
from animal3dbox.evaluate.tables import Table, wilson_bounds

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DPI = 110
WORLD_WORDS = {"own": "animals like ours", "foreign": "animals built otherwise"}
"""A world of the table of fits -> its words in the plot."""
BODY_COLORS = ("#bbbbbb", "#0072b2", "#e69f00")
"""Of rigid, fitted and true bodies: told apart by colour-blind people too."""
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
        "fits": _fits,
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


def _stability(records: list[dict[str, Any]]) -> "Figure | None":
    protocols = list(dict.fromkeys(r["protocol"] for r in records))
    figure, panels = new_figure(12, 3.6, 1, max(len(protocols), 1))
    sigmas = [
        float(c.removeprefix("sigma "))
        for c in (records[0] if records else {})
        if c.startswith("sigma ")
    ]
    for panel, protocol in zip(panels, protocols, strict=False):
        of_protocol = [r for r in records if r["protocol"] == protocol]
        if _is_left_out(panel, protocol, [r[f"sigma {s:g}"] for r in of_protocol for s in sigmas]):
            continue
        for number, record in enumerate(of_protocol):
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
    if figure.axes:
        figure.axes[0].set_ylabel("mean rotation, degrees")
        figure.axes[-1].legend(
            fontsize=7, title="dotted: the paper's figures", title_fontsize=7, loc="lower right"
        )
    return _without_gaps(figure)


def _accuracy(records: list[dict[str, Any]]) -> "Figure | None":
    figure, panels = new_figure(12, 4.2)
    others = ("rule", "animals", "p95 deg", "IoU3D median")
    groups = [c for c in (records[0] if records else {}) if c not in others]
    if _is_left_out(panels[0], "degrees", [r.get(group) for r in records for group in groups]):
        return None
    _bars(panels[0], records, "rule", groups)
    panels[0].set(yscale="log", ylabel="median angle to the true trunk, degrees")
    panels[0].legend(fontsize=7, loc="upper left", bbox_to_anchor=(1, 1))
    return figure


def _is_left_out(panel: "Axes", name: str, values: Sequence[float | None]) -> bool:
    """Take a panel away that would be empty, and say so at the figure's foot; whether it was."""
    if any(values):
        return False
    reason = "not known" if all(value is None for value in values) else "0 for all"
    figure = panel.get_figure(root=True)
    if figure is not None:
        words = [figure.get_supxlabel(), f"{name}: {reason}"]
        figure.supxlabel("; ".join(filter(None, words)), fontsize=9)
    panel.remove()
    return True


def _without_gaps(figure: "Figure") -> "Figure | None":
    """The figure with the panels that are left moved together; None without any."""
    if not figure.axes:
        return None
    spec = figure.axes[0].get_subplotspec()
    if spec is not None:
        columns = min(spec.get_gridspec().ncols, len(figure.axes))
        grid = figure.add_gridspec(math.ceil(len(figure.axes) / columns), columns)
        for number, panel in enumerate(figure.axes):
            panel.set_subplotspec(grid[divmod(number, columns)])
    return figure


def _pose(records: list[dict[str, Any]]) -> "Figure | None":
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
        if _is_left_out(panel, measure, [r.get(setting) for r in table for setting in settings]):
            continue
        _bars(panel, table, "method", settings)
        panel.set(ylabel=measure, **({} if measure.startswith("IoU") else {"yscale": "symlog"}))
        panel.set_xticks(panel.get_xticks(), settings, rotation=40, ha="right", fontsize=7)
    return _without_gaps(figure)


def _reproduction(records: list[dict[str, Any]]) -> "Figure | None":
    figure, panels = new_figure(12, 3.6, 1, 2)
    parts, methods = (
        list(dict.fromkeys(r["keypoints"] for r in records)),
        list(dict.fromkeys(r["method"] for r in records)),
    )
    for panel, measure, published in zip(
        panels, ("mean px", "degenerate %"), (75.28, 13.81), strict=True
    ):
        by_method = [
            {"method": m, **{r["keypoints"]: r[measure] for r in records if r["method"] == m}}
            for m in methods
        ]
        if _is_left_out(panel, measure, [r.get(part) for r in by_method for part in parts]):
            continue
        _bars(panel, by_method, "method", parts)
        panel.axhline(published, color="black", linestyle=":", linewidth=1)
        panel.set(ylabel=f"{measure} (dotted: the paper's basic)")
    return _without_gaps(figure)


def _faces(records: list[dict[str, Any]]) -> "Figure | None":
    figure, panels = new_figure(12, 3.2, 1, 2)
    errors = ("in-frame share mean error", "in-frame share max error")
    for panel, measures in zip(panels, (errors, ("box to surface mean",)), strict=True):
        if _is_left_out(panel, measures[0], [r.get(m) for r in records for m in measures]):
            continue
        by_measure = [{"measure": m, **{r["view"]: r[m] for r in records}} for m in measures]
        _bars(panel, by_measure, "measure", [r["view"] for r in records])
        if measures == errors:
            panel.axhline(0.01, color="black", linestyle=":", linewidth=1)
            panel.set(yscale="log", ylabel="share (dotted: allowed)")
        else:
            panel.set(ylabel="share")
    return _without_gaps(figure)


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
    """Stated confidence against the share that is right: a panel a kind of labels, with counts."""
    kinds = list(dict.fromkeys(r["labels"] for r in records))
    figure, panels = new_figure(max(5.5, 4.6 * len(kinds)), 4.8, 1, len(kinds))
    for panel, kind in zip(panels, kinds, strict=True):
        points = [r for r in records if r["labels"] == kind]
        stated, right = [r["told"] for r in points], [r["true"] for r in points]
        bounds = [wilson_bounds(round(r["true"] * r["n"]), r["n"]) for r in points]
        below = [max(0.0, share - low) for share, (low, _) in zip(right, bounds, strict=True)]
        above = [max(0.0, high - share) for share, (_, high) in zip(right, bounds, strict=True)]
        panel.plot((0, 1), (0, 1), color="black", linestyle=":", linewidth=1, label="as stated")
        panel.errorbar(stated, right, (below, above), color="tab:blue", alpha=0.35, linestyle="")
        panel.plot(stated, right, color="tab:blue", marker="o", label="labels, with 95 % bounds")
        counts = sorted({r["n"] for r in points})
        a_point = " or ".join(str(count) for count in counts)
        total = sum(r["n"] for r in points)
        panel.set_title(f"labels {kind}: {total}, {a_point} a point", fontsize=10)
        panel.set(xlabel="confidence that labels state", xlim=(-0.03, 1.03), ylim=(-0.03, 1.03))
        panel.legend(fontsize=8, loc="upper left")
    panels[0].set_ylabel("share of them that is right")
    return figure


def _fits(records: list[dict[str, Any]]) -> "Figure | None":
    """A row a world, a column a measure: classes of animals by fitted, rigid and true bodies."""
    measures = {
        "trunk median deg": (
            "trunk turned, degrees: median, line to 95 %; less is better",
            "trunk p95 deg",
        ),
        "IoU median": ("overlap with the true box: median; 1 is best", None),
    }
    measured = [r for r in records if any(r.get(name) for name in measures)]
    worlds = list(dict.fromkeys(r["world"] for r in measured))
    if not worlds:
        return None
    n_classes = len({r["class"] for r in measured})
    figure, panels = new_figure(12, 0.4 + (1.1 + 0.4 * n_classes) * len(worlds), len(worlds), 2)
    for number, world in enumerate(worlds):
        rows = [r for r in measured if r["world"] == world]
        for panel, (measure, (words, end)) in zip(
            panels[2 * number :], measures.items(), strict=False
        ):
            if _is_left_out(panel, f"{world}, {measure}", [r.get(measure) for r in rows]):
                continue
            _grouped_rows(panel, rows, measure, end=end)
            panel.set_title(f"{WORLD_WORDS.get(world, world)}\n{words}", fontsize=9, loc="left")
    bodies = figure.axes[0].get_legend_handles_labels()
    figure.legend(*bodies, loc="outside upper left", ncols=len(BODY_COLORS), fontsize=9)
    return _without_gaps(figure)


def _grouped_rows(
    panel: "Axes", records: list[dict[str, Any]], measure: str, *, end: str | None
) -> None:
    """Bars of several bodies a class, the first class above, and lines to another measure."""
    classes = list(dict.fromkeys(r["class"] for r in records))
    bodies = list(dict.fromkeys(r["body"] for r in records))
    height = 0.8 / len(bodies)
    for place, body in enumerate(bodies):
        of_body = [r for r in records if r["body"] == body and r.get(measure) is not None]
        ys = [classes.index(r["class"]) - 0.4 + (place + 0.5) * height for r in of_body]
        color = BODY_COLORS[place % len(BODY_COLORS)]
        panel.barh(ys, [r[measure] for r in of_body], 0.9 * height, color=color, label=body)
        for y, r in zip(ys, of_body, strict=True):
            if end is not None and r.get(end) is not None:
                panel.plot((r[measure], r[end]), (y, y), color="black", linewidth=0.8)
    counts = {name: max(r["animals"] for r in records if r["class"] == name) for name in classes}
    names = [f"{name} ({counts[name]})" for name in classes]
    panel.set_yticks(range(len(classes)), names, fontsize=8)
    panel.invert_yaxis()
    panel.margins(y=0.02)
    panel.set_xlim(left=0)


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
    """Groups of bars, one a record in each group; what is unknown has none."""
    width = 0.8 / max(len(records), 1)
    for number, record in enumerate(records):
        numbers = [i for i, group in enumerate(groups) if record.get(group) is not None]
        places = [i + (number - (len(records) - 1) / 2) * width for i in numbers]
        panel.bar(places, [record[groups[i]] for i in numbers], width, label=record[name])
    panel.set_xticks(range(len(groups)), list(groups), fontsize=8)
    panel.legend(fontsize=7, ncols=5, loc="lower left", bbox_to_anchor=(0, 1))  # above the bars
