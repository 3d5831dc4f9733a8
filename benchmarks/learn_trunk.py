"""Learn what axes without a template know of trunks, and write it into the package.

Of each line between landmarks (trunk_line.LINES): by how much it rises above the trunk's axis, the
mean of the ten species with keypoints at the quadruped's own places, and how it scatters where
annotators put them elsewhere. Of sections: how the pitch of a frame follows from the heights of
back and belly in it, by a robust ridge regression. All of it on bodies of the foreign world with
seeds 0 to 59 (every second dataset stands never, and is re-meshed); tables are made on others.

Run: python benchmarks/learn_trunk.py animal3dbox/labels/assets/learned_trunk.json (ten minutes)
"""

import json
import sys
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from animal3dbox.datasets.synthetic.foreign.animals import foreign_animal
from animal3dbox.datasets.synthetic.foreign.bodies import merged_mesh
from animal3dbox.datasets.synthetic.foreign.config import ForeignConfig
from animal3dbox.labels.axes.section_axes import (
    LEAST_SECTIONS,
    PitchWeights,
    outline_heights,
    section_axes,
)
from animal3dbox.labels.axes.trunk_line import (
    LINES,
    TrunkLine,
    frame_along,
    pitch_between,
    pitched,
    trunk_ends,
)
from animal3dbox.labels.axes.trunk_sections import trunk_sections
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES
from animal3dbox.smal.keypoints.vocabulary import vocabulary_from_names
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped

Array = NDArray[np.float64]
Landmarks = Mapping[str, Array]
DATASETS, ANIMALS = 60, 10
CELL = 0.02
DISTURBANCE_DEG = (5.0, 2.0)
"""Standard deviations of the pitch and the roll by which frames are turned for the regression."""
RIDGE, HUBER_DEG = 100.0, 4.0
P95_TO_SD = 1 / 1.96
"""A standard deviation that counts the tails: some animals bend far, and they matter most."""
EVERYWHERE = vocabulary_from_names(
    "everywhere",
    {
        name: name
        for name in load_quadruped().landmark_groups
        if not name.startswith("joint:") and "tip" not in name
    },
)
"""All landmarks of the quadruped, so that one body serves every vocabulary."""
SUBSETS = tuple(
    frozenset(name for names in vocabulary.landmarks for name in names)
    for vocabulary in VOCABULARIES.values()
)


class LearnedBody:
    """A body with what it teaches: its mesh, landmarks, trunk and dataset."""

    def __init__(self, dataset: int, index: int, config: ForeignConfig) -> None:
        animal = foreign_animal(dataset, index, config, dataset=0)
        vertices, landmarks = animal.fitted
        faces = animal.model.faces
        if dataset % 2:
            vertices, faces = merged_mesh(vertices, faces, CELL)
        self.dataset, self.trunk = dataset, animal.trunk.numpy()
        self.vertices, self.faces = vertices.numpy(), faces.numpy()
        places = zip(EVERYWHERE.keypoints, landmarks.numpy(), strict=True)
        self.landmarks: Landmarks = dict(places)

    def pitch(self, line: TrunkLine) -> float:
        """Degrees by which a line rises above the trunk's axis."""
        axes = frame_along(self.landmarks, line)
        if axes is None:
            raise ValueError(f"the quadruped has no line {line.name}")
        return -pitch_between(axes.R_box, self.trunk)


def main() -> None:
    """Learn, and write the file named on the command line."""
    torch.set_num_threads(1)
    bodies = [
        LearnedBody(dataset, index, _config(dataset, 0.08))
        for dataset in range(DATASETS)
        for index in range(ANIMALS)
    ]
    plain = [LearnedBody(0, index, _config(0, 0.0)) for index in range(10 * ANIMALS)]
    lines = {line.name: _facts(line, bodies, plain) for line in LINES}
    content = {"lines": lines, "sections": _sections(bodies, lines)}
    Path(sys.argv[1]).write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def _config(dataset: int, places: float) -> ForeignConfig:
    config = ForeignConfig(
        places=places, places_of_animal=places / 4, standing=0.0 if dataset % 2 else 0.5
    )
    world = replace(config.world, vocabulary=EVERYWHERE, image_hw=(48, 64))
    return replace(config, world=world)


def _facts(
    line: TrunkLine, bodies: list[LearnedBody], plain: list[LearnedBody]
) -> dict[str, float]:
    """The fields of LineFacts."""
    nominal = float(np.median([body.pitch(line) for body in plain]))
    pitch = np.array([body.pitch(line) for body in bodies])
    datasets = np.array([body.dataset for body in bodies])
    within = pitch.copy()
    for dataset in set(datasets.tolist()):
        within[datasets == dataset] -= np.median(pitch[datasets == dataset])
    return {
        "pitch_deg": round(nominal, 1),
        "sd_deg": _spread(pitch - nominal),
        "sd_within_deg": _spread(within),
    }


def _spread(errors_deg: Array) -> float:
    """The standard deviation of a normal distribution with the same 95th percentile."""
    return round(P95_TO_SD * float(np.quantile(abs(errors_deg), 0.95)), 1)


def _sections(bodies: list[LearnedBody], lines: dict[str, dict[str, float]]) -> dict[str, object]:
    """The fields of PitchWeights."""
    rng = np.random.default_rng(0)
    rows, turns = zip(*_disturbed(bodies, rng), strict=True)
    weights, constant = _ridge(np.array(rows), np.array(turns))
    pitch_weights = PitchWeights(weights.round(3), round(constant, 4), 0.0)
    errors = list(_section_errors(bodies, pitch_weights, lines))
    print(f"{len(rows)} views, {len(errors)} axes: median {np.median(np.abs(errors)):.2f} deg")
    return {
        "weights": pitch_weights.weights.tolist(),
        "constant": pitch_weights.constant,
        "sd_deg": _spread(np.array(errors)),
    }


def _subsets(body: LearnedBody) -> Iterator[Landmarks]:
    """A body's landmarks as each vocabulary has them."""
    for subset in SUBSETS:
        yield {name: place for name, place in body.landmarks.items() if name in subset}


def _disturbed(
    bodies: list[LearnedBody], rng: np.random.Generator
) -> Iterator[tuple[Array, float]]:
    """Heights in frames near the trunk's, and by how many radians these point up."""
    for body in bodies:
        for landmarks in _subsets(body):
            pitch, roll = rng.normal(size=2) * DISTURBANCE_DEG
            angle = np.deg2rad(roll)
            turn = np.array(
                [[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]]
            )
            R_box = pitched(body.trunk, pitch) @ turn
            ends = trunk_ends(landmarks)
            length = 0.0 if ends is None else float((ends[1] - ends[0]) @ R_box[:, 0])
            if ends is None or length <= 0:
                continue
            sections = trunk_sections(
                body.vertices, body.faces, R_box=R_box, rear=ends[0], length=length
            )
            if sections.is_complete.sum() >= LEAST_SECTIONS:
                yield outline_heights(sections, length), float(np.deg2rad(pitch))


def _ridge(rows: Array, values: Array) -> tuple[Array, float]:
    """Weights and constant of a ridge regression on standardised columns, robust (Huber)."""
    mean, sd = rows.mean(0), rows.std(0)
    design = np.c_[(rows - mean) / sd, np.ones(len(rows))]
    penalty = RIDGE * np.diag([1.0] * len(sd) + [0.0])
    share = np.ones(len(rows))
    solution = np.zeros(design.shape[1])
    for _ in range(8):
        normal = design.T @ (design * share[:, None]) + penalty
        solution = np.linalg.solve(normal, design.T @ (share * values))
        share = 1 / np.maximum(1, abs(values - design @ solution) / np.deg2rad(HUBER_DEG))
    weights = solution[:-1] / sd
    return weights, float(solution[-1] - weights @ mean)


def _section_errors(
    bodies: list[LearnedBody], weights: PitchWeights, lines: dict[str, dict[str, float]]
) -> Iterator[float]:
    """Degrees by which the axes of sections point too high, from where labels start."""
    for body in bodies:
        for landmarks in _subsets(body):
            axes = next(
                (axes for line in LINES if (axes := frame_along(landmarks, line)) is not None), None
            )
            ends = trunk_ends(landmarks)
            if axes is None or ends is None:
                continue
            R_box = section_axes(
                body.vertices,
                body.faces,
                start=pitched(axes.R_box, -lines[axes.line.name]["pitch_deg"]),
                ends=ends,
                weights=weights,
            )
            if R_box is not None:
                yield pitch_between(body.trunk, R_box)


if __name__ == "__main__":
    main()
