"""Predictions laid on truths, greedily by score, as COCO's evaluator does."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from animal3dbox.training.metrics.box_table import Flags, Floats, Whole
from animal3dbox.training.metrics.candidates import Block, Candidates


@dataclass(frozen=True)
class Matches:
    """Which truth each prediction hits, at T thresholds of the IoU.

    Attributes:
        truth: (D, T) the truth that a prediction hits; -1: none.
        hit: (D, T) whether that is a hit which counts.
        ignored: (D, T) whether a prediction counts neither as hit nor as false alarm.
        counted_truths: (G,) the truths that ought to be hit.
    """

    truth: Whole
    hit: Flags
    ignored: Flags
    counted_truths: Flags


def match(
    candidates: Candidates,
    iou: Floats,
    thresholds: Sequence[float],
    *,
    eligible: Flags | None = None,
    ignored_truths: Flags | None = None,
    ignored_if_unmatched: Flags | None = None,
) -> Matches:
    """Let each prediction, best score first, take the free truth that it overlaps most.

    A truth that is ignored is taken only if no other is free; it then counts neither way. Of equal
    overlaps the last truth is taken, as COCO's evaluator does.

    Args:
        candidates: D predictions and G truths with their P pairs.
        iou: (P,) of each pair.
        thresholds: T least overlaps of a hit.
        eligible: (P,) pairs that may hit at all; None: all.
        ignored_truths: (G,) truths that count neither way; None: crowds alone.
        ignored_if_unmatched: (D,) predictions that are no false alarms; None: none.

    """
    count, levels = len(candidates.predictions), np.minimum(np.array(thresholds), 1 - 1e-10)
    crowd = candidates.truths.crowd
    ignored_truths = crowd if ignored_truths is None else ignored_truths | crowd
    truth = np.full((count, len(levels)), -1)
    iou = iou if eligible is None else np.where(eligible, iou, -1.0)
    for block in candidates.blocks():
        _match_block(
            candidates,
            block,
            iou=iou[block.pairs],
            levels=levels,
            ignored_truths=ignored_truths,
            truth=truth,
        )
    matched = truth >= 0
    to_ignored = np.zeros_like(matched)
    to_ignored[matched] = ignored_truths[truth[matched]]
    ignored = to_ignored | ~candidates.counted[:, None]
    if ignored_if_unmatched is not None:
        ignored |= ~matched & ignored_if_unmatched[:, None]
    return Matches(truth, matched & ~to_ignored, ignored, ~ignored_truths)


def _match_block(
    candidates: Candidates,
    block: Block,
    *,
    iou: Floats,
    levels: Floats,
    ignored_truths: Flags,
    truth: Whole,
) -> None:
    """Match the groups of a block, and write the truths that were hit into (D, T)."""
    prediction, of_truth = (index[block.pairs] for index in candidates.pairs)
    groups, ranks, slots = block.shape
    overlap: Floats = np.full(block.shape, -1.0)
    overlap[block.cells] = iou
    number = np.full(block.shape, -1)
    number[block.cells] = of_truth
    predicted = np.full((groups, ranks), -1)
    predicted[block.cells[:2]] = prediction
    flags = np.zeros((2, groups, 1, slots), bool)
    flags[:, block.cells[0], 0, block.cells[2]] = (
        ignored_truths[of_truth],
        candidates.truths.crowd[of_truth],
    )
    ignored, crowd = flags
    taken = np.zeros((groups, len(levels), slots), bool)
    for rank in range(ranks):
        row = overlap[:, rank, None]
        free = (row >= levels[:, None]) & ~taken  # (groups, T, slots)
        firm = free & ~ignored
        free = np.where(firm.any(2, keepdims=True), firm, free)
        best = slots - 1 - np.where(free, row, -1.0)[..., ::-1].argmax(2)
        hit = free.any(2) & (predicted[:, rank, None] >= 0)
        at = np.nonzero(hit)
        truth[predicted[at[0], rank], at[1]] = number[at[0], rank, best[at]]
        taken[(*at, best[at])] = ~np.broadcast_to(crowd, taken.shape)[(*at, best[at])]
