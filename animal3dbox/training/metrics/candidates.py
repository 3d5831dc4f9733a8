"""Which predictions can hit which truths: the pairs of one image and class, and their IoU.

Images and classes are joined into groups, each a block of (predictions, truths) filled up with
nothing, so that all groups are matched together.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from animal3dbox.geometry.box_overlap import box_iou
from animal3dbox.training.metrics.box_table import BoxTable, Flags, Floats, Whole

BLOCK_CELLS = 1_000_000
"""About so many pairs of prediction and truth are matched in one go."""
PAIRS_AT_ONCE = 65_536
"""So many cuboids are intersected in one go."""


@dataclass(frozen=True, kw_only=True)
class Candidates:
    """Predictions and truths of I images, in groups of one image and class.

    Attributes:
        predictions: D boxes, in the order of images.
        truths: G boxes, likewise.
        prediction_image: (D,) the image of each.
        truth_image: (G,) the image of each.
        images: how many images there are, I.
        max_detections: so many predictions of a group count, the best.
    """

    predictions: BoxTable
    truths: BoxTable
    prediction_image: Whole
    truth_image: Whole
    images: int
    max_detections: int

    @cached_property
    def groups(self) -> tuple[Whole, Whole]:
        """The group of each prediction (D,) and of each truth (G,)."""
        count = len(self.predictions)
        keys = np.stack(
            (
                np.concatenate((self.prediction_image, self.truth_image)),
                np.concatenate((self.predictions.label, self.truths.label)),
            )
        )
        _, group = np.unique(keys, axis=1, return_inverse=True)
        group = group.reshape(-1)
        return group[:count], group[count:]

    @cached_property
    def rank(self) -> Whole:
        """The place (D,) of each prediction in its group, 0 for the highest score."""
        return _places(self.groups[0], -self.predictions.score)

    @cached_property
    def slot(self) -> Whole:
        """The place (G,) of each truth in its group."""
        return _places(self.groups[1], np.zeros(len(self.truths)))

    @cached_property
    def counted(self) -> Flags:
        """Which predictions (D,) are among the best of their groups."""
        return self.rank < self.max_detections

    @cached_property
    def pairs(self) -> tuple[Whole, Whole]:
        """Prediction and truth (P,) of each pair of one group, usable predictions that count."""
        of_prediction, of_truth = self.groups
        order = np.argsort(of_truth, kind="stable")
        first = np.searchsorted(of_truth[order], of_prediction, side="left")
        last = np.searchsorted(of_truth[order], of_prediction, side="right")
        counts = np.where(self.counted & self.predictions.usable, last - first, 0)
        prediction = np.repeat(np.arange(len(self.predictions)), counts)
        within = np.arange(len(prediction)) - np.repeat(np.cumsum(counts) - counts, counts)
        return prediction, order[np.repeat(first, counts) + within]

    def overlaps(self, scale: float = 1.0) -> Floats:
        """The IoU (P,) of the cuboids of each pair, the predictions' world scaled by a factor."""
        prediction, truth = self.pairs
        iou = np.zeros(len(prediction))
        for start in range(0, len(prediction), PAIRS_AT_ONCE):
            part = slice(start, start + PAIRS_AT_ONCE)
            iou[part] = box_iou(
                self.predictions.cuboids(prediction[part], scale),
                self.truths.cuboids(truth[part]),
            ).numpy()
        return np.nan_to_num(iou)

    def box_overlaps(self) -> Floats:
        """The IoU (P,) of the upright boxes of each pair; 0 where one has none."""
        prediction, truth = self.pairs
        a, b = self.predictions.box[prediction], self.truths.box[truth]
        sides = np.minimum(a[:, 2:], b[:, 2:]) - np.maximum(a[:, :2], b[:, :2])
        common = np.maximum(sides, 0).prod(1)
        with np.errstate(all="ignore"):
            areas = [np.maximum(box[:, 2:] - box[:, :2], 0).prod(1) for box in (a, b)]
            return np.asarray(np.nan_to_num(common / (areas[0] + areas[1] - common)))

    def blocks(self) -> Iterator["Block"]:
        """Groups that have pairs, some at a time, those of like sizes together."""
        prediction, truth = self.pairs
        of_prediction, _ = self.groups
        group = of_prediction[prediction]
        present, number = np.unique(group, return_inverse=True)
        sizes = np.zeros((len(present), 2), np.int64)
        np.maximum.at(sizes[:, 0], number, self.rank[prediction] + 1)
        np.maximum.at(sizes[:, 1], number, self.slot[truth] + 1)
        order = np.argsort(sizes.prod(1), kind="stable")
        start = 0
        while start < len(order):
            cells = np.maximum.accumulate(sizes[order[start:]], axis=0).prod(1)
            much = cells * np.arange(1, len(cells) + 1) > BLOCK_CELLS
            stop = start + max(1, int(much.argmax()) if much.any() else len(cells))
            local = np.full(len(present), -1)
            local[order[start:stop]] = np.arange(stop - start)
            here = np.flatnonzero(local[number] >= 0)
            depth, width = sizes[order[start:stop]].max(0)
            where = (local[number[here]], self.rank[prediction[here]], self.slot[truth[here]])
            yield Block(here, where, (stop - start, int(depth), int(width)))
            start = stop


@dataclass(frozen=True)
class Block:
    """Groups of like sizes, whose pairs are cells of one array.

    Attributes:
        pairs: (P',) which pairs lie in it.
        cells: group, rank and slot (P',) of each.
        shape: (groups, ranks, slots).
    """

    pairs: Whole
    cells: tuple[Whole, Whole, Whole]
    shape: tuple[int, int, int]


def _places(group: Whole, key: Floats) -> Whole:
    """The place (N,) of each element in its group by rising key; of equal keys the first first."""
    order = np.lexsort((key, group))
    ordered = group[order]
    first = np.searchsorted(ordered, ordered, side="left")
    places = np.empty(len(group), np.int64)
    places[order] = np.arange(len(group)) - first
    return places
