"""What a Dataset gives: samples of images and targets, and what stands in the place of others."""

import difflib
import inspect
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NoReturn

from torch import Tensor
from torch.utils.data._utils.collate import default_collate_fn_map

from animal3dbox.datasets.labelling.load_report import Case

Target = dict[str, Any]
"""A plain dict: the fields of target_schema.FIELDS, image_id and meta."""
COLLATE_REMEDY = (
    "images and targets of one batch differ in size and number of animals: give the DataLoader"
    " collate_fn=dataset.collate_fn"
)


class Sample(tuple[Tensor, Target]):
    """An image and its target: a plain pair, which torch's own collate is told not to stack."""

    __slots__ = ()


def _refuse_to_stack(samples: Sequence[Sample], **_: object) -> NoReturn:
    raise TypeError(COLLATE_REMEDY)


default_collate_fn_map[Sample] = _refuse_to_stack


@dataclass(frozen=True)
class Skipped:
    """In place of a sample that cannot be used; collate leaves it out.

    Attributes:
        index: in the Dataset.
        image_id: the image.
        cases: why, animal by animal.

    Example:
        >>> Skipped(3, "a.jpg", ()).image_id
        'a.jpg'
    """

    index: int
    image_id: str
    cases: tuple[Case, ...]


def _refuse_to_leave_out(batch: Sequence[Skipped], **_: object) -> NoReturn:
    """Refuse a batch with a skipped sample in torch's own collate, which can leave nothing out."""
    raise TypeError(
        f"{batch[0].image_id} was skipped (on_bad='skip'), which only the dataset's own collate"
        " understands: give the DataLoader collate_fn=dataset.collate_fn"
    )


default_collate_fn_map[Skipped] = _refuse_to_leave_out


RENAMED: Mapping[str, tuple[str, str]] = {
    "transforms": ("transform", "one callable for the image and its target together"),
    "target_transform": ("transform", "one callable for the image and its target together"),
    "pose": ("stored_cameras", "'hypothesis' or 'exact'"),
    "path": ("root", "the dataset's folder or annotation file"),
    "train": ("split", "'train', 'test' or 'all'"),
    "split": ("root", "the annotation file of the split that you want: each is in its own"),
    "download": ("root", "where you have put the dataset yourself: nothing is downloaded"),
}
"""Keywords that other libraries' Datasets have -> the keyword to write here, and its value."""


def refuse_unknown(kind: type, unknown: Mapping[str, object], options: Iterable[str]) -> None:
    """Raise a TypeError that names the right word for keywords that a Dataset does not know.

    Args:
        kind: the Dataset's class.
        unknown: the keywords.
        options: those that every Dataset has, besides those that its class names.

    """
    own = inspect.signature(kind).parameters.values()
    named = (p.name for p in own if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY))
    known = sorted({*options, *named})
    for name in unknown:
        word, value = RENAMED.get(name, ("", ""))
        if word in known:
            raise TypeError(f"{kind.__name__} has no {name}=: write {word}=, {value}")
        near = difflib.get_close_matches(name, known, n=1)
        hint = f" (nearest: {near[0]})" if near else ""
        raise TypeError(f"{kind.__name__} has no {name}={hint}; it has {', '.join(known)}")
