"""The page that `demo` ends at: every animal's true box and its label, side by side."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.synthetic.scenes import SyntheticAnimal
from animal3dbox.evaluate.box_errors import FLANK_DEG, lateral_deg
from animal3dbox.files import write_whole
from animal3dbox.geometry.cuboid import Cuboid
from animal3dbox.labels.types import CuboidLabel, Rejection
from animal3dbox.plurals import counted
from animal3dbox.report.gallery import card_picture
from animal3dbox.report.html_page import render
from animal3dbox.report.overlay import DrawnCuboid, cuboids_in_picture

NEITHER = "neither"
"""The true flank of an animal that is seen from ahead or behind."""


@dataclass(frozen=True)
class ComparedAnimal:
    """An animal as the page shows it.

    Attributes:
        title: the sample.
        truth: JPEG with the true box, in base64.
        label: JPEG with the label's box, in base64; without one, the picture as it is.
        true_flank: "left", "right" or "neither".
        flank: as the label names it; None without a label.
        words: about the label.
    """

    title: str
    truth: str
    label: str
    true_flank: str
    flank: str | None
    words: str

    @property
    def is_wrong(self) -> bool:
        """Whether a flank is seen and the label names the other one, or the animal has no label."""
        if self.flank is None:
            return True
        other = {"left": "right", "right": "left"}.get(self.true_flank)
        return self.flank == other


def true_flank(box: Cuboid) -> str:
    """The flank that a true box (camera frame) shows; neither within 20 degrees of its axis.

    Example:
        >>> import torch
        >>> turned = torch.tensor([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]], dtype=torch.float64)
        >>> ahead = torch.tensor([0.0, 0, 5], dtype=torch.float64)
        >>> true_flank(Cuboid(ahead, turned, torch.ones(3, dtype=torch.float64)))
        'right'
    """
    if lateral_deg(box) <= FLANK_DEG:
        return NEITHER
    to_camera_left = float((-box.rotation.mT @ box.center)[1])
    return "left" if to_camera_left > 0 else "right"


def compared_animal(animal: SyntheticAnimal, outcome: CuboidLabel | Rejection) -> ComparedAnimal:
    """An animal's two pictures, and what its truth and its label say of the flank."""
    truth = _picture(animal, animal.cuboid)
    if isinstance(outcome, Rejection):
        words = f"none, {outcome.reason}: {outcome.detail}"
        plain = _picture(animal, None)
        return ComparedAnimal(
            animal.sample_id, truth, plain, true_flank(animal.cuboid), flank=None, words=words
        )
    return ComparedAnimal(
        animal.sample_id,
        truth,
        _picture(animal, outcome.cuboid),
        true_flank(animal.cuboid),
        flank=outcome.flank,
        words=f"flank {outcome.flank} ({outcome.flank_confidence:.0%} sure)",
    )


def _picture(animal: SyntheticAnimal, box: Cuboid | None) -> str:
    """The animal's picture with a box of the camera frame, as JPEG in base64."""
    pixels: NDArray[np.uint8] = animal.image.numpy()
    cuboids = [] if box is None else [DrawnCuboid(box, animal.K)]
    canvas = cuboids_in_picture(pixels, cuboids)
    return base64.b64encode(card_picture(canvas)).decode()


def write_demo_page(path: Path, animals: Sequence[ComparedAnimal], about: str) -> None:
    """Write the page, with nothing to load; it links to gallery.html and evaluation.html beside it.

    Args:
        path: the HTML file.
        animals: in their order.
        about: what was drawn and how it was labelled.

    """
    telling = [one for one in animals if one.true_flank != NEITHER]
    page = render(
        "animal3dbox.cli",
        "demo.html",
        title=f"{counted(len(animals), 'synthetic animal')}: truth and labels",
        about=about,
        right=sum(one.flank == one.true_flank for one in telling),
        shown=len(telling),
        animals=animals,
        neither=NEITHER,
    )
    write_whole(path, page.encode())
