"""Mixes of animals, bodies and faults on which a label's confidence is learned and judged.

Two families with different dials: `learned` is what the shipped coefficients were made with,
`judged` what they are reported on. Each dial of the first is wider than of the second: who fits
a probability on narrow faults is too sure, or too unsure, of others.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import torch

from animal3dbox.datasets.bodies.sources import ModelBody, preset_body
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.datasets.synthetic.faults import FaultConfig
from animal3dbox.datasets.synthetic.foreign.animals import ForeignAnimal, foreign_animal
from animal3dbox.datasets.synthetic.foreign.config import ALONE, ForeignConfig
from animal3dbox.datasets.synthetic.world.config import world_generator
from animal3dbox.evaluate.reliability import Judged
from animal3dbox.geometry.rigid_transforms import rotation_angle
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.label import label_animal
from animal3dbox.labels.types import CuboidLabel

BAD_DEG = 15.0
"""A label is bad if its cuboid is turned by more than this from the trunk's truth."""


@dataclass(frozen=True)
class Family:
    """The dials of one mix.

    Attributes:
        name: of the mix.
        first_seed: seeds are this and the next ones.
        bodies: body source -> part of the animals: "own" with its model, "alone" without,
            "misfit" with its model but joints off, "species" and "dog" rigid presets.
        noise_px: range of the keypoints' noise.
        outliers: greatest part of them.
        missing: greatest part of them.
        joint_deg: greatest misfit of joints.
        swapped: part of the animals with exchanged sides, half of them of all keypoints.
        unknown_focal: part of the images without K.
        wrong_focal: part of those whose K is wrong by a factor.
        masks: part of the animals with a mask.
        mask_px: greatest growth or shrinkage of a mask.
        holes: part of the masks with holes.
        places: see ForeignConfig.
        proportions: see ForeignConfig.
        standing: see ForeignConfig.

    Example:
        >>> FAMILIES["judged"].first_seed
        1000
    """

    name: str
    first_seed: int
    bodies: tuple[tuple[str, float], ...]
    noise_px: tuple[float, float]
    outliers: float
    missing: float
    joint_deg: float
    swapped: float
    unknown_focal: float
    wrong_focal: float
    masks: float
    mask_px: int
    holes: float
    places: float
    proportions: float
    standing: float


FAMILIES = {
    family.name: family
    for family in (
        Family(
            name="learned",
            first_seed=0,
            bodies=(("own", 0.2), ("alone", 0.2), ("misfit", 0.3), ("species", 0.2), ("dog", 0.1)),
            noise_px=(0.7, 8.0),
            outliers=0.45,
            missing=0.45,
            joint_deg=8.0,
            swapped=0.2,
            unknown_focal=0.3,
            wrong_focal=0.15,
            masks=0.6,
            mask_px=5,
            holes=0.4,
            places=0.1,
            proportions=1.2,
            standing=0.5,
        ),
        Family(
            name="judged",
            first_seed=1000,
            bodies=(
                ("own", 0.3),
                ("alone", 0.1),
                ("misfit", 0.25),
                ("species", 0.3),
                ("dog", 0.05),
            ),
            noise_px=(1.5, 6.0),
            outliers=0.35,
            missing=0.3,
            joint_deg=5.0,
            swapped=0.15,
            unknown_focal=0.35,
            wrong_focal=0.1,
            masks=0.7,
            mask_px=3,
            holes=0.3,
            places=0.08,
            proportions=1.0,
            standing=0.65,
        ),
    )
}
"""Name -> mix."""
_NARROWER = replace(
    FAMILIES["learned"],
    noise_px=(1.0, 4.0),
    outliers=0.25,
    missing=0.4,
    unknown_focal=0.25,
    masks=0.7,
    mask_px=4,
    holes=0.2,
    places=0.06,
    proportions=0.8,
)
FITTED: Mapping[str, Family] = {
    name: replace(family, bodies=(("fit", 1.0),))
    for name, family in {"learned": _NARROWER, "judged": FAMILIES["judged"]}.items()
}
"""The mixes of animals whose bodies are fitted to the picture; half of their species are known.

Fits are learned on milder faults: on those of the others most fits are bad, and what is learned
there is too low a probability elsewhere.
"""
KNOWN_SPECIES = 0.5
TOLD_TO_A_FIT = ("image_hw", "keypoints_2d", "K", "mask", "vocabulary", "sample_id")


@dataclass(frozen=True, eq=False)
class Case:
    """One animal of a mix, with what a dataset would give.

    Attributes:
        animal: the truth.
        body: the body source's name in Family.bodies.
        arguments: label_animal's, by name.
    """

    animal: ForeignAnimal
    body: str
    arguments: dict[str, Any]


@dataclass(frozen=True)
class Outcome:
    """The label of a case beside the truth.

    Attributes:
        body: see Case.
        has_mask: whether it came with a mask.
        label: as made.
        rotation_deg: of the box from the trunk's truth, in the camera frame.
        corner_part: mean distance of the corners from the true box's by the true diagonal, boxes
            with centres and diagonals aligned: one camera sees neither distance nor size.
    """

    body: str
    has_mask: bool
    label: CuboidLabel
    rotation_deg: float
    corner_part: float


def mixed_case(family: Family, index: int) -> Case:
    """The case of an index of a mix; the same whatever was drawn before.

    Example:
        >>> case = mixed_case(FAMILIES["learned"], 0)
        >>> case.body in dict(FAMILIES["learned"].bodies)
        True
    """
    seed = family.first_seed + index % 50
    rng = world_generator(seed, index, f"mix-{family.name}")
    names, parts = zip(*family.bodies, strict=True)
    body = str(rng.choice(names, p=parts))
    swap = rng.choice(["all", "legs", "fore", "hind", "head"], p=[0.5, 0.125, 0.125, 0.125, 0.125])
    faults = FaultConfig(
        noise_px=rng.uniform(*family.noise_px),
        outliers=rng.uniform(0, family.outliers) * (rng.random() < 0.5),
        missing=rng.uniform(0, family.missing),
        joint_deg=rng.uniform(0, family.joint_deg) if body == "misfit" else 0.0,
        swap=str(swap) if rng.random() < family.swapped else "none",  # type: ignore[arg-type]
        mask_px=int(rng.integers(-family.mask_px, family.mask_px + 1)),
    )
    world = replace(ALONE, principal_offset=0.05, uav=rng.choice([0.0, 1.0], p=[0.65, 0.35]))
    config = ForeignConfig(
        world=world,
        faults=faults,
        standing=family.standing,
        proportions=family.proportions,
        places=family.places,
        mask_holes=family.holes,
    )
    animal = foreign_animal(seed, index, config)
    arguments = animal.arguments(template=body in ("own", "misfit"))
    if body in ("species", "dog"):
        arguments |= preset_arguments("dog" if body == "dog" else animal.preset, animal)
    focal = rng.random()
    if focal < family.unknown_focal:
        arguments["K"] = None
    elif focal < family.unknown_focal + family.wrong_focal:
        wrong = float(np.exp(rng.choice([-1, 1]) * rng.uniform(0.2, 0.9)))
        arguments["K"] = arguments["K"] @ torch.diag(torch.tensor([wrong, wrong, 1.0]).double())
    if rng.random() > family.masks:
        arguments["mask"] = None
    if body == "fit":
        species = animal.preset if rng.random() < KNOWN_SPECIES else None
        arguments = {name: arguments[name] for name in TOLD_TO_A_FIT}
        arguments |= {"body": "fit", "species": species}
    return Case(animal, body, arguments)


@cache
def _preset(name: str) -> ModelBody:
    return preset_body(name)


def preset_arguments(preset: str, animal: ForeignAnimal) -> dict[str, Any]:
    """The rigid standing body of a species, as label_animal's arguments."""
    record = AnimalRecord(
        sample_id=animal.sample_id,
        image_id=animal.sample_id,
        image_path=None,
        image_hw=animal.camera.image_hw,
        vocabulary=animal.vocabulary,
        keypoints_2d=animal.keypoints_2d.numpy(),
        mask_runs=None,
        category=preset,
    )
    body = _preset(preset).body(record)
    return {
        "vertices": body.vertices,
        "faces": body.faces,
        "keypoints_3d": body.landmarks,
        "landmark_sigma": body.landmark_sigma,
        "template": body.template,
    }


def outcomes(
    family: Family, indices: Iterable[int], config: LabelConfig | None = None
) -> Iterator[Outcome]:
    """The labels of cases beside their truth; animals that are rejected are left out."""
    for index in indices:
        case = mixed_case(family, index)
        label = label_animal(**case.arguments, config=config or LabelConfig(surface_share=False))
        if isinstance(label, CuboidLabel):
            yield _outcome(case, label)


def _outcome(case: Case, label: CuboidLabel) -> Outcome:
    """The label of a case beside its truth."""
    truth = case.animal.cuboid
    angle = float(torch.rad2deg(rotation_angle(label.rotation, truth.rotation)))
    # About their centres and of one diagonal: distance and size are not seen by one camera.
    scale = truth.diagonal / label.cuboid.diagonal
    apart = (label.corners_3d - label.center) * scale - (truth.corners() - truth.center)
    error = torch.linalg.vector_norm(apart, dim=-1).mean()
    return Outcome(
        body=case.body,
        has_mask=case.arguments["mask"] is not None,
        label=label,
        rotation_deg=angle,
        corner_part=float(error / truth.diagonal),
    )


def judged_cases(indices: Iterable[int]) -> Iterator[Judged]:
    """The confidences of the mix "judged" beside the truth.

    Example:
        >>> [0 < one.probability < 1 for one in judged_cases(range(1))]
        [True]
    """
    for one in outcomes(FAMILIES["judged"], indices):
        quality = one.label.quality
        yield Judged(
            body=one.body,
            has_mask=one.has_mask,
            probability=one.label.confidence,
            is_good=one.rotation_deg < BAD_DEG,
            corner_error=quality.expected_corner_error or 0.0,
            corner_part=one.corner_part,
        )
