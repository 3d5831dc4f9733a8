"""The doors: one animal from arrays to a label, or many at once."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from animal3dbox.labels.assemble import assemble_labels
from animal3dbox.labels.body import ArrayLike, Body
from animal3dbox.labels.calibration import Calibration
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.drafts import LabelDraft, draft_labels
from animal3dbox.labels.fit.fitted_observation import (
    BodyChoice,
    checked_choice,
    fitted_observations,
)
from animal3dbox.labels.observation import Observation, observe
from animal3dbox.labels.types import CuboidLabel, Rejection
from animal3dbox.smal.keypoints.vocabulary import Vocabulary
from animal3dbox.smal.model import SmalModel

BEHIND = (
    "all of its box is behind the camera: the camera does not see it, or R and t are not those of a"
    " camera with x right, y down, z forward (of OpenGL's axes, negate the last two rows of R"
    " and t)"
)


def label_animal(
    image_hw: tuple[int, int],
    keypoints_2d: ArrayLike = None,
    keypoints_3d: ArrayLike = None,
    vertices: ArrayLike = None,
    *,
    faces: ArrayLike = None,
    template: SmalModel | None = None,
    K: ArrayLike = None,
    pose: ArrayLike = None,
    pose_hypotheses: ArrayLike = (),
    mask: ArrayLike = None,
    vocabulary: str | Vocabulary = "animal3d26",
    sample_id: str | None = None,
    config: LabelConfig | None = None,
    landmark_sigma: ArrayLike = None,
    distortion: ArrayLike = None,
    down_cam: ArrayLike = None,
    species: str | None = None,
    calibration: Calibration | Path | str | None = None,
    body: BodyChoice = "given",
) -> CuboidLabel | Rejection:
    """The oriented cuboid of one animal, its camera and the faces seen (the whole of section 2).

    Arrays may be tensors, NumPy arrays or lists; all is computed in float64.

    Args:
        image_hw: height and width of the image.
        keypoints_2d: (J, 3) x, y in px and visibility (0 hidden or missing, else a confidence in
            (0, 1]).
        keypoints_3d: (J, 3) the same landmarks on the body, in the mesh's own frame and unit; NaN
            where it has none. Read off the template's vertex groups if left out.
        vertices: (V, 3) the posed mesh, same frame; without it the box bounds the landmarks, and
            the label says so.
        faces: (F, 3) its triangles, for the overlap with the mask.
        template: the body template that the vertices correspond to one to one, if any.
        K: (3, 3) in px; None: its focal length is estimated with the pose, or guessed
            (LabelConfig.focal), and the label says so.
        pose: (R, t) known exactly, X_cam = R X + t: no keypoints needed, no PnP.
        pose_hypotheses: further (R, t) to start from.
        mask: (H, W), above 0 on the animal.
        vocabulary: the keypoints' names: a known vocabulary or your own.
        sample_id: named in every error.
        config: the method.
        landmark_sigma: (J,) how far each landmark may be from where the body has it, in the mesh's
            unit, for a body that is not in the animal's pose; None: the body is. Used by method
            "default".
        distortion: (4,), (5,), (8,) or (12,) coefficients of OpenCV's lens, k1 k2 p1 p2 [k3 [k4 k5
            k6 [s1 s2 s3 s4]]]; None: the picture has none. Pixels, of keypoints and mask as of the
            label, are the distorted picture's. The pose is solved for the keypoints and the mask's
            outline as they would be without the lens; a box that reaches beyond the lens's field of
            view is rejected.
        down_cam: (3,) unit, gravity's direction in the camera frame, where it is known; helps to
            choose between poses that explain the keypoints about equally well.
        species: the animal's category, by which a calibration tells animals apart.
        calibration: what the animal's dataset taught about its keypoints' places, or the file of it
            (`animal3dbox calibrate`); its placement counts for bodies without a template, its
            places and shapes for body="fit".
        body: "fit" fits a body, of the template's model or the embedded quadruped, to the keypoints
            and the mask (see fit_animal): no vertices, no keypoints_3d, no pose and no lens then.
            The species counts if it is one of the quadruped's presets. The label's confidence is
            that of a rigid body with as much evidence.

    Returns:
        A label, or a rejection with its reason.

    Raises:
        SampleError: an argument is wrong; names the sample, the argument and the remedy.
        ConfigError: the vocabulary is not known, or the calibration's file is none.

    Example:
        >>> from animal3dbox import label_animal
        >>> from animal3dbox.datasets.synthetic import synthetic_animal
        >>> animal = synthetic_animal(seed=0, index=2)
        >>> label = label_animal(
        ...     animal.image_hw, animal.keypoints_2d, vertices=animal.vertices,
        ...     template=animal.model, K=animal.K, mask=animal.mask)
        >>> label.side, label.size.round(decimals=1)
        ('right', tensor([1.2000, 0.3000, 0.8000], dtype=torch.float64))
    """
    animal = {
        "image_hw": image_hw,
        "keypoints_2d": keypoints_2d,
        "keypoints_3d": keypoints_3d,
        "vertices": vertices,
        "faces": faces,
        "template": template,
        "K": K,
        "pose": pose,
        "pose_hypotheses": pose_hypotheses,
        "mask": mask,
        "vocabulary": vocabulary,
        "sample_id": sample_id,
        "landmark_sigma": landmark_sigma,
        "distortion": distortion,
        "down_cam": down_cam,
        "species": species,
        "calibration": calibration,
        "body": body,
    }
    return label_many([animal], config)[0]


def label_many(
    animals: Iterable[Mapping[str, Any]], config: LabelConfig | None = None
) -> list[CuboidLabel | Rejection]:
    """label_animal for many animals: the same labels.

    Cheaper where cameras are known and images have one size.

    Args:
        animals: label_animal's arguments by name, of one animal each, without config. Bodies too
            are cheaper posed many at once (smal.parameters.posed_bodies).
        config: the method.

    Returns:
        Labels and rejections, in order.

    Raises:
        SampleError: an argument is wrong; names the sample, the argument and the remedy.
        ConfigError: a vocabulary is not known.

    Example:
        >>> landmarks = {"vertices": [[0, 0, 0], [2, 0, 0], [0, 1, 0], [0, 0, 1.0]]}
        >>> label_many([{"image_hw": (48, 64), "sample_id": "a", **landmarks}])[0].reason
        'no_axes'
    """
    config = config or LabelConfig()
    requests = [dict(animal) for animal in animals]
    is_fit = [checked_choice(request) == "fit" for request in requests]
    fitted = iter(
        fitted_observations([r for r, fit in zip(requests, is_fit, strict=True) if fit], config)
    )
    observations = [
        next(fitted) if fit else _observed(request, config)
        for request, fit in zip(requests, is_fit, strict=True)
    ]
    known = [one for one in observations if isinstance(one, Observation)]
    labels = iter(label_observations(known, config))
    return [one if isinstance(one, Rejection) else next(labels) for one in observations]


def _observed(arguments: dict[str, Any], config: LabelConfig) -> Observation:
    """The checked animal of label_animal's arguments, with the body given."""
    body = Body(
        vertices=arguments.pop("vertices", None),
        faces=arguments.pop("faces", None),
        landmarks=arguments.pop("keypoints_3d", None),
        landmark_sigma=arguments.pop("landmark_sigma", None),
        template=arguments.pop("template", None),
    )
    return observe(body=body, config=config, **arguments)


def label_observations(
    observations: Sequence[Observation], config: LabelConfig
) -> list[CuboidLabel | Rejection]:
    """The labels of checked animals, or why they have none, in order."""
    outcomes = draft_labels(observations, config)
    drafts = [outcome for outcome in outcomes if isinstance(outcome, LabelDraft)]
    labels = iter(
        _unless_degenerate(label, draft.observation, config)
        for label, draft in zip(assemble_labels(drafts), drafts, strict=True)
    )
    return [next(labels) if isinstance(outcome, LabelDraft) else outcome for outcome in outcomes]


def _unless_degenerate(
    label: CuboidLabel, observation: Observation, config: LabelConfig
) -> CuboidLabel | Rejection:
    """The label, unless it is degenerate (section 3.2, degenerate).

    Its camera looks away, or is estimated and its projected box far smaller than the animal.
    """
    if not label.field("corner_in_front").any():
        return Rejection(observation.sample_id, "behind_camera", BEHIND)
    if observation.camera_is_known:
        return label
    if observation.mask is not None:
        animal_px = float(np.count_nonzero(observation.mask))
    elif observation.keypoints_2d is not None:
        keypoints = observation.keypoints_2d[observation.visible, :2]
        animal_px = float((keypoints.max(0) - keypoints.min(0)).prod())
    else:
        animal_px = 0.0
    box_px = float(label.field("face_area").sum())
    if box_px < config.degenerate_area * animal_px:
        return Rejection(
            observation.sample_id,
            "degenerate_box",
            f"the projected box covers {box_px:.1f} px^2, the animal {animal_px:.0f} px^2",
        )
    return label
