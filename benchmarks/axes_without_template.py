"""Axes of foreign bodies that come without a template: the rule of before, and today's.

Twelve datasets whose annotators put keypoints elsewhere than we do (sigma 0.08 of the trunk's
length, 0.02 more for each animal), of stretched bodies that labelling was not made with; 20 animals
of each are judged, of which none is among the 10 or 50 that its calibration is learned from. Worlds
differ in how many animals stand, and half of the datasets are re-meshed. Seeds are 1000 and above,
proportions spread 1.3 times as far as where constants were learned (benchmarks/learn_trunk.py).

Run: python benchmarks/axes_without_template.py (ten minutes; or one table of it, by a word of its
title: half, none, level)
"""

import sys
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from animal3dbox.datasets.synthetic.foreign.animals import foreign_animal
from animal3dbox.datasets.synthetic.foreign.bodies import merged_mesh
from animal3dbox.datasets.synthetic.foreign.config import ForeignConfig
from animal3dbox.geometry.rigid_transforms import nearest_rotation, rotation_angle
from animal3dbox.labels.axes.body_axes import DISAGREEMENT_DEG, body_axes, named_landmarks
from animal3dbox.labels.axes.placement import learned_angle, learned_placement
from animal3dbox.labels.body import Body
from animal3dbox.labels.calibration import Calibration
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.observation import Observation, observe
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES
from animal3dbox.smal.keypoints.vocabulary import Vocabulary, vocabulary_from_names
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, preset_betas, quadruped_names

Array = NDArray[np.float64]
FIRST_SEED, DATASETS, JUDGED = 1000, 12, 20
CALIBRATED = (10, 50)
PROPORTIONS, CELL = 1.3, 0.03
NAMES = ("animal3d26", "ap10k17", "stanfordextra24", "superanimal39")
WORLDS: dict[str, float] = {
    "half standing": 0.5,
    "none standing": 0.0,
}
EVERYWHERE = vocabulary_from_names(
    "everywhere",
    {name: name for name in load_quadruped().landmark_groups if not name.startswith("joint:")},
)
"""All landmarks of the quadruped: one body, and one placement, serves every vocabulary."""
TRUNK = ("tail_base", "left_shoulder", "right_shoulder", "left_hip", "right_hip")
NEAR_TRUNK = (
    *TRUNK,
    "withers",
    *("left_front_elbow", "right_front_elbow", "left_back_knee", "right_back_knee", "neck"),
)


@dataclass(frozen=True)
class Subject:
    """A body without a template, and its true trunk.

    Attributes:
        trunk: (3, 3) R_world_box.
        observations: the body as each vocabulary has it, by the vocabulary's name.
    """

    trunk: Array
    observations: Mapping[str, Observation]


def main() -> None:
    """Print median and 95th percentile of the angle to the true trunk, in degrees."""
    torch.set_num_threads(1)
    word = sys.argv[1] if len(sys.argv) > 1 else ""
    for world, standing in WORLDS.items():
        if word not in world:
            continue
        config = ForeignConfig(proportions=PROPORTIONS, standing=standing)
        judge(world, config)
    if word in "level":
        level()


def judge(world: str, config: ForeignConfig) -> None:
    """The table of one world."""
    angles: dict[tuple[str, str], list[float]] = defaultdict(list)
    warned: dict[str, list[tuple[bool, float]]] = defaultdict(list)
    for number in range(DATASETS):
        count = max(CALIBRATED) + JUDGED
        seed = FIRST_SEED + number
        subjects = [
            subject(seed, index, config, re_meshed=number % 2 == 1) for index in range(count)
        ]
        for name in NAMES:
            learned = [_learned(subjects[:n], name) for n in CALIBRATED]
            for one in subjects[max(CALIBRATED) :]:
                observation = one.observations[name]
                angles[name, "before"].append(_off(old_axes(named_landmarks(observation)), one))
                bare = replace(observation, body=replace(observation.body, vertices=None))
                angles[name, "line alone"].append(_off(_axes(bare)[0], one))
                R_box, warnings = _axes(observation)
                angles[name, "single image"].append(_off(R_box, one))
                warned[name].append((bool(warnings), _off(_axes(bare)[0], one)))
                for n, calibration in zip(CALIBRATED, learned, strict=True):
                    R_box = _axes(replace(observation, calibration=calibration))[0]
                    angles[name, f"calibrated on {n}"].append(_off(R_box, one))
    rules = ("before", "line alone", "single image", *(f"calibrated on {n}" for n in CALIBRATED))
    print(f"\n{world}, {DATASETS * JUDGED} animals a vocabulary: median / 95 % degrees")
    for name in (*NAMES, "all"):
        cells = [_cell(angles, name, rule) for rule in rules]
        print(f"{name:16}", *(f"{rule}: {cell}  " for rule, cell in zip(rules, cells, strict=True)))
    for name in NAMES:
        _print_warnings(name, warned[name])


def level() -> None:
    """Bodies whose shoulders are as high as their tail's base, as SMAL's groups are."""
    config = ForeignConfig(
        proportions=PROPORTIONS, places=0.0, places_of_animal=0.0, shoulders="level"
    )
    subjects = [subject(2000, index, config) for index in range(200)]
    before, now, alone = [], [], []
    for one in subjects:
        observation = one.observations["animal3d26"]
        before.append(_off(old_axes(named_landmarks(observation)), one))
        now.append(_off(_axes(observation)[0], one))
        bare = replace(observation, body=replace(observation.body, vertices=None))
        alone.append(_off(_axes(bare)[0], one))
    print(
        f"\nlevel shoulders, animal3d26, {len(now)} animals: before {_pair(before)}, line alone"
        f" {_pair(alone)}, single image {_pair(now)}"
    )


def subject(seed: int, index: int, config: ForeignConfig, *, re_meshed: bool = False) -> Subject:
    """An animal of a dataset (the seed), as all vocabularies have it."""
    world = replace(config.world, vocabulary=EVERYWHERE, image_hw=(48, 64))
    animal = foreign_animal(seed, index, replace(config, world=world), dataset=0)
    vertices, places = animal.fitted
    faces = animal.model.faces
    if re_meshed:
        vertices, faces = merged_mesh(vertices, faces, CELL)
    rows = dict(zip(EVERYWHERE.keypoints, places.numpy(), strict=True))
    observations = {
        name: observe(
            image_hw=(48, 64),
            body=Body(vertices, faces, _rows(rows, VOCABULARIES[name]), None, None),
            vocabulary=name,
            species=animal.preset,
            config=LabelConfig(),
        )
        for name in NAMES
    }
    return Subject(animal.trunk.numpy(), observations)


def _rows(places: Mapping[str, Array], vocabulary: Vocabulary) -> Array:
    """A vocabulary's keypoints (J, 3) of landmarks by name."""
    nowhere = np.full(3, np.nan)
    return np.array(
        [
            next((places[name] for name in names if name in places), nowhere)
            for names in vocabulary.landmarks
        ]
    )


def _learned(subjects: Sequence[Subject], name: str) -> Calibration:
    angles = (learned_angle(one.observations[name]) for one in subjects)
    return learned_placement(angle for angle in angles if angle is not None)


def _axes(observation: Observation) -> tuple[Array, tuple[str, ...]]:
    axes = body_axes([observation], "default")[0]
    if axes is None:
        raise ValueError(f"{observation.vocabulary.name} gives no axes")
    return axes.R_box, axes.warnings


def old_axes(landmarks: Mapping[str, Array]) -> Array:
    """The rule of before: the quadruped's own landmarks turned onto these, preset by preset."""
    places = dict(landmarks)
    for side in ("left", "right"):
        for kind in ("blade", "point"):
            if f"{side}_shoulder_{kind}" in places:
                places[f"{side}_shoulder"] = places[f"{side}_shoulder_{kind}"]
    for pool in (TRUNK, NEAR_TRUNK):
        names = [name for name in pool if name in places]
        is_rear = {
            name.startswith(("tail", "left_hip", "right_hip", "left_back")) for name in names
        }
        has_pair = any(name.startswith("left_") for name in names)
        if has_pair and len(is_rear) == 2:
            here = torch.from_numpy(np.stack([places[name] for name in names]))
            here = here - here.mean(0)
            turns = [nearest_rotation(here.mT @ layout) for layout in _layouts(names)]
            return np.asarray(nearest_rotation(torch.stack(turns).sum(0)))
    raise ValueError("the landmarks do not tell sides and ends")


def _layouts(names: Sequence[str]) -> list[torch.Tensor]:
    """The places (N, 3) of landmarks on every preset, about their mean; shoulders are points."""
    model = load_quadruped()
    bodies = model.shaped(torch.stack([preset_betas(name) for name in quadruped_names().presets]))
    groups = [
        list(model.landmark_groups[f"{name}_point" if name.endswith("shoulder") else name])
        for name in names
    ]
    layouts = [torch.stack([body[group].mean(0) for group in groups]) for body in bodies]
    return [layout - layout.mean(0) for layout in layouts]


def _off(R_box: Array, one: Subject) -> float:
    """Degrees from the true trunk."""
    angle = rotation_angle(torch.from_numpy(R_box), torch.from_numpy(one.trunk))
    return float(torch.rad2deg(angle))


def _cell(angles: Mapping[tuple[str, str], list[float]], name: str, rule: str) -> str:
    """Median and 95th percentile of a vocabulary, or of all."""
    names = NAMES if name == "all" else (name,)
    return _pair([angle for one in names for angle in angles[one, rule]])


def _pair(angles: Sequence[float]) -> str:
    return f"{np.median(angles):5.2f} /{np.quantile(angles, 0.95):6.2f}"


def _print_warnings(name: str, rows: Sequence[tuple[bool, float]]) -> None:
    """How often the cross-check warns where the line is off by more than its limit, and else."""
    for kind, chosen in (
        ("off by more", [warns for warns, off in rows if off > DISAGREEMENT_DEG]),
        ("off by less", [warns for warns, off in rows if off <= DISAGREEMENT_DEG]),
    ):
        part = np.mean(chosen) if chosen else float("nan")
        many = f"{len(chosen)} lines {kind} than {DISAGREEMENT_DEG:g} degrees"
        print(f"  {name}: {many}, warned {part:.0%}")


if __name__ == "__main__":
    main()
