"""What an evaluation asked and what came out, in sentences that are made from its tables."""

from collections.abc import Callable, Mapping
from typing import Any

from animal3dbox.evaluate.tables import PAPER, Table, shown
from animal3dbox.plurals import counted

Record = Mapping[str, Any]

QUESTIONS = {
    "stability": "How far do the box's axes turn when annotations are noisy?",
    "accuracy": "How near are the box's axes to the true trunk?",
    "pose": "How well is the camera's pose found from faulty keypoints?",
    "reproduction": "Do keypoints left at (0, 0) explain the paper's figures?",
    "faces": "Are the faces that a box shows, and their shares, those that rays find?",
    "foreign": "Do poses hold for animals that are built otherwise than ours?",
    "reliability": "Can the confidence of a label be believed?",
    "curve": "Of labels that state a confidence, how many are right?",
    "fits": "Is a fitted body better than a rigid one?",
    "dataset": "How well do labels fit what was annotated?",
}
"""Name of a table of the evaluation -> the question that it answers, as its heading."""
PLOT_DESCRIPTIONS = {
    "stability": "Lines: by how many degrees the axes turn, against the noise, a line a rule; lower"
    " is steadier. The scale is logarithmic.",
    "accuracy": "Bars: the median angle between the axes and the true trunk, for all animals and by"
    " pose; lower is better. The scale is logarithmic.",
    "pose": "Bars: errors by kind of fault in the annotations, a colour a method; for the first"
    " three panels lower is better, for the overlap (IoU3D) higher.",
    "reproduction": "Bars: errors of the baseline by how many keypoints are at (0, 0); the dotted"
    " line is what the paper printed.",
    "faces": "Bars: by how much shares of the faces differ from those that rays find, by kind of"
    " view; below the dotted line is allowed. The left scale is logarithmic.",
    "foreign": "Bars: by how many degrees the box is turned against the true one, by how the"
    " animals differ from ours; the line goes on to what 95 % stay below.",
    "curve": "Points: groups of labels, at the confidence that they state on average, and as high"
    " as the share of them that is right; the bars are 95 % bounds. On the dotted line as many are"
    " right as was stated; below it labels promise too much.",
    "fits": "Bars: errors of boxes by a rigid dog, by a body fitted to the animal, and by its true"
    " body, for all animals and by class, with the number of animals; a thin line goes on to what"
    " 95 % stay below.",
    "dataset": "Bars: how well labels fit the annotations, a bar a method; a line goes on to what"
    " 95 % of the animals reach.",
}
"""Name of a table with a plot -> what one sees in it."""


def records_of(table: Table) -> list[dict[str, Any]]:
    """A table's records without the paper's published ones."""
    return [
        record
        for record in table.records()
        if not any(isinstance(value, str) and PAPER in value for value in record.values())
    ]


def answers_of(table: Table) -> list[str]:
    """What came out, in two or three sentences with the table's numbers.

    A sentence whose numbers are not known is left out; a table of another name has none.

    Example:
        >>> from animal3dbox.evaluate.dataset_study import DatasetRow, dataset_table
        >>> table = dataset_table([DatasetRow("a.jpg", "default", None, annotated_px=3.5)])
        >>> answers_of(table)[0]
        'The default labelled 1 of 1 animal.'
    """
    sentences = _ANSWERS.get(table.name)
    return [] if sentences is None else sentences(records_of(table))


def _row(records: list[dict[str, Any]], **wanted: str) -> Record:
    """The record with these values; an empty one if there is none."""
    return next(
        (r for r in records if all(r.get(name) == value for name, value in wanted.items())), {}
    )


def _sentence(template: str, **values: float | str | None) -> list[str]:
    """The template with its numbers; nothing if one of them is not known."""
    if any(value is None for value in values.values()):
        return []
    words = {name: v if isinstance(v, str) else shown(v) for name, v in values.items()}
    return [template.format(**words)]


def _counted(count: int | None, noun: str) -> str | None:
    """A count with its noun; None if it is not known."""
    return None if count is None else counted(count, noun)


def _dataset(records: list[dict[str, Any]]) -> list[str]:
    default = _row(records, method="default")
    sentences = []
    for method, words in (("default", "default"), ("basic", "paper's baseline (basic)")):
        row = _row(records, method=method)
        n, total = row.get("labelled"), row.get("animals")
        sentences += _sentence(
            "The {words} labelled {n} of {total}.",
            words=words,
            n=n,
            total=_counted(total, "animal"),
        )
        sentences += _sentence(
            "Its keypoints are off by a median of {px} px.", px=row.get("annotated median px")
        )
    truth = _sentence(
        "Against the true boxes the default is turned by a median of {deg} degrees, and overlaps"
        " them by {iou} of 1 (3D IoU).",
        deg=default.get("rotation median deg"),
        iou=default.get("IoU3D median"),
    )
    return sentences + (
        truth
        or [
            "There are no true boxes to compare with: this says how labels fit, not how true"
            " they are."
        ]
    )


def _stability(records: list[dict[str, Any]]) -> list[str]:
    def turn(protocol: str, rule: str) -> float | None:
        value = _row(records, protocol=protocol, rule=rule).get("theta_R deg")
        return None if value is None else float(value)

    in_space = _sentence(
        "When points of the body are off by as much as some pixels are, our axes turn by {ours}"
        " degrees on average, the paper's by {paper}.",
        ours=turn("pixel-equivalent", "ours, mesh"),
        paper=turn("pixel-equivalent", "landmarks (paper)"),
    )
    return in_space + _sentence(
        "Noisy image keypoints turn ours by {ours} degrees, through the camera's pose.",
        ours=turn("camera", "ours, mesh"),
    )


def _accuracy(records: list[dict[str, Any]]) -> list[str]:
    ours = _row(records, rule="ours, mesh")
    return _sentence(
        "Over {animals} our axes are off the true trunk by a median of {ours} degrees (95 % below"
        " {p95}), the paper's by {paper}, and principal components by {pca}.",
        animals=_counted(ours.get("animals"), "animal"),
        ours=ours.get("median deg"),
        p95=ours.get("p95 deg"),
        paper=_row(records, rule="landmarks (paper)").get("median deg"),
        pca=_row(records, rule="pca of mesh").get("median deg"),
    )


def _pose(records: list[dict[str, Any]]) -> list[str]:
    return [
        sentence
        for setting in ("2 px", "2 px, 10 % outliers")
        for sentence in _sentence(
            "With keypoints off by {setting}, the default's box is turned by a median of {ours}"
            " degrees, the baseline's (basic) by {basic}.",
            setting=setting.replace(",", " and"),
            ours=_row(records, setting=setting, method="default").get("rotation median deg"),
            basic=_row(records, setting=setting, method="basic").get("rotation median deg"),
        )
    ]


def _reproduction(records: list[dict[str, Any]]) -> list[str]:
    part = str(records[-1]["keypoints"]) if records else ""
    return _sentence(
        "With {part}, the baseline that is given them as keypoints is off by {fed} px on average,"
        " and by {dropped} px where they are dropped.",
        part=part,
        fed=_row(records, keypoints=part, method="basic").get("mean px"),
        dropped=_row(records, keypoints=part, method="basic, (0, 0) dropped").get("mean px"),
    )


def _faces(records: list[dict[str, Any]]) -> list[str]:
    judged = [r for r in records if r.get("booleans right %") is not None]
    return _sentence(
        "Which faces are seen is right for at least {right} % of the faces in each of {n} kinds of"
        " view; a share is wrong by {error} at most.",
        n=str(len(judged)),
        right=min((r["booleans right %"] for r in judged), default=None),
        error=max((r["in-frame share max error"] for r in judged), default=None),
    )


def _foreign(records: list[dict[str, Any]]) -> list[str]:
    judged = [r for r in records if r.get("rotation median deg") is not None]
    worst = max(judged, key=lambda record: float(record["rotation median deg"]), default={})
    first = judged[0] if judged else {}
    return _sentence(
        "The box is turned by a median of {first} degrees ({setting}); worst is {worst}, with {deg}"
        " degrees.",
        first=first.get("rotation median deg"),
        setting=first.get("setting"),
        worst=worst.get("setting"),
        deg=worst.get("rotation median deg"),
    )


def _reliability(records: list[dict[str, Any]]) -> list[str]:
    sentences = []
    for mask in ("with", "without"):
        row = _row(records, labels=f"all, {mask} mask")
        sentences += _sentence(
            "Of {labels} {mask} a mask {bad} % are bad.",
            labels=_counted(row.get("n"), "label"),
            mask=mask,
            bad=row.get("bad %"),
        )
        sentences += _sentence(
            "A good one of them has more confidence than a bad one with a probability of {auc}.",
            auc=row.get("AUC"),
        )
    return sentences


def _curve(records: list[dict[str, Any]]) -> list[str]:
    sentences = []
    for kind in dict.fromkeys(r["labels"] for r in records):
        bins = [r for r in records if r["labels"] == kind]
        first, last = bins[0], bins[-1]
        who = "the most confident" if len(bins) > 1 else "all"
        words = f"Of labels {kind}, {who} (which state {last['told']:.0%} on average) are right in"
        words += f" {_count_of_right(last)}"
        if len(bins) > 1:
            words += f", the least confident ({first['told']:.0%}) in {_count_of_right(first)}"
        sentences.append(f"{words}.".replace("%", "\N{NO-BREAK SPACE}%"))
    return sentences


def _count_of_right(group: Record) -> str:
    """How many labels of a bin of the reliability curve are right, in words."""
    return f"{round(group['true'] * group['n'])} of {group['n']}"


def _fits(records: list[dict[str, Any]]) -> list[str]:
    def row(body: str) -> Record:
        return _row(records, **{"world": "foreign", "class": "all", "body": body})

    return _sentence(
        "On the foreign world the fitted body's trunk is off by a median of {fit} degrees, a rigid"
        " dog's by {rigid}, the true body's by {true}.",
        fit=row("fit").get("trunk median deg"),
        rigid=row("rigid dog").get("trunk median deg"),
        true=row("true body").get("trunk median deg"),
    )


_ANSWERS: Mapping[str, Callable[[list[dict[str, Any]]], list[str]]] = {
    "stability": _stability,
    "accuracy": _accuracy,
    "pose": _pose,
    "reproduction": _reproduction,
    "faces": _faces,
    "foreign": _foreign,
    "reliability": _reliability,
    "curve": _curve,
    "fits": _fits,
    "dataset": _dataset,
}
