"""Labels of single animals from arrays, and the keypoint vocabularies, for the golden record."""

from pathlib import Path
from typing import Any

import numpy as np
from golden_names import attribute, made, named
from golden_values import GoldenValues

METHODS: dict[str, dict[str, str]] = {
    "basic": {"method": "basic"},
    "paper-vector": {"method": "paper", "residual": "vector"},
    "paper-literal": {"method": "paper", "residual": "literal"},
    "default": {"method": "default"},
}
Arguments = dict[str, Any]
AXES = ("default", "landmarks", "pca")
TOLD = (
    "cuboid", "camera_in_box", "azimuth_deg", "elevation_deg", "viewpoint", "side",
    "surface_side", "confidence",
)  # fmt: skip
"""What a label says beside its fields."""


def label_config(**choices: Any) -> Any:
    """A config of the label method."""
    return made(named("animal3dbox.LabelConfig"), **choices)


def configs() -> dict[str, Any]:
    """Every method and every choice of axes, by name."""
    known = {name: label_config(**choices) for name, choices in METHODS.items()}
    known |= {f"axes-{axes}": label_config(axes=axes) for axes in AXES if axes != "default"}
    known["paper-landmarks"] = label_config(**METHODS["paper-vector"], axes="landmarks")
    return known | {"basic-pca": label_config(**METHODS["basic"], axes="pca")}


def add_label(values: GoldenValues, name: str, label: Any) -> None:
    """Record a label with what it says beside its fields, or a rejection."""
    values.add(name, label)
    if hasattr(label, "corners_3d"):
        for told in TOLD:
            values.add(f"{name}/{told}", attribute(label, told))


def record_labels(values: GoldenValues, inputs: Path, scratch: Path) -> None:
    """Record the labels of animals under every method, and of one with less or more known."""
    template = named("animal3dbox.smal.model_files.load_model")(inputs / "animals-model.pkl")
    animals: list[dict[str, Any]] = []
    poses = []
    for path in sorted((inputs / "arrays").glob("*.npz")):
        arrays = dict(np.load(path))
        poses.append((arrays.pop("R"), arrays.pop("t")))
        hw = arrays["mask"].shape
        animals.append({**arrays, "image_hw": hw, "template": template, "sample_id": path.stem})
    label_animal = named("animal3dbox.label_animal")
    for name, config in configs().items():
        with values.section(f"label_animal {name}"):
            for number, animal in enumerate(animals):
                add_label(values, f"array/{name}/{number}", label_animal(**animal, config=config))
    with values.section("label_many"):
        known = [{**one, "pose": pose} for one, pose in zip(animals, poses, strict=True)]
        for number, label in enumerate(named("animal3dbox.label_many")(known + animals[:2])):
            add_label(values, f"array/many/{number}", label)
    for name, changes in _knowledge(animals[1], poses[1]).items():
        with values.section(f"label_animal {name}"):
            given = {key: value for key, value in changes.items() if value is not None}
            add_label(values, f"array/{name}", label_animal(**given))


def _knowledge(animal: Arguments, pose: tuple[np.ndarray, np.ndarray]) -> dict[str, Arguments]:
    """Arguments by which one animal is known in less or in other ways; None leaves one out."""
    few = animal["keypoints_2d"] * (np.arange(26) < 5)[:, None]
    wrong = animal["keypoints_2d"].copy()
    wrong[::6, :2] += 40.0
    without = {"vertices": None, "faces": None, "template": None}
    changes: dict[str, dict[str, Any]] = {
        "known": {"pose": pose},
        "known-bare": {"pose": pose, "keypoints_2d": None, "mask": None},
        "hypothesis": {"pose_hypotheses": (pose,)},
        "no-template": {"template": None},
        "no-mesh": without,
        "no-mesh-paper": {**without, "config": label_config(**METHODS["paper-vector"])},
        "no-mask": {"mask": None},
        "no-camera": {"K": None},
        "no-tail": {"config": label_config(tail="drop")},
        "outliers": {"keypoints_2d": wrong},
        "sigma": {"landmark_sigma": np.full(26, 0.05)},
        "lens": {"distortion": np.array([0.02, -0.01, 0.001, 0.0005])},
        "few": {"keypoints_2d": few},
        "away": {"pose": (pose[0] * np.array([[1], [-1], [-1]]), -pose[1])},
        "fast": {"config": label_config(surface_share=False, mask_iou=False, margin=0.01)},
    }
    return {name: {**animal, **change} for name, change in changes.items()}


def record_vocabularies(values: GoldenValues, inputs: Path, scratch: Path) -> None:
    """Record the names, places and mirror images of every vocabulary's keypoints."""
    for name, words in named("animal3dbox.smal.vocabularies.VOCABULARIES").items():
        values.add(f"vocabularies/{name}", words)
        values.add(f"vocabularies/{name}/sides", words.sides)
