"""The doors: one animal from arrays to a label, or many at once."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from animal3dbox.labels.assemble import Prepared, assemble_labels
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.observation import ArrayLike, Observation, observe
from animal3dbox.labels.prepare import prepare
from animal3dbox.labels.types import CuboidLabel, Rejection
from animal3dbox.smal.keypoints.vocabulary import Vocabulary
from animal3dbox.smal.model import SmalModel

UNKNOWN: Mapping[str, Any] = {
    "keypoints_2d": None, "keypoints_3d": None, "landmark_sigma": None, "vertices": None, "faces": None, "template": None, "K": None,
    "pose": None, "pose_hypotheses": (), "mask": None, "vocabulary": "animal3d26", "sample_id": None,
}  # fmt: skip
"""label_animal's arguments that may be left out."""
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
) -> CuboidLabel | Rejection:
    """The oriented cuboid of one animal, the camera that sees it and the faces that are seen (the whole of section 2).

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
        K: (3, 3) in px; None: guessed (LabelConfig.focal_guess), and the label says so.
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

    Returns:
        A label, or a rejection with its reason.

    Raises:
        SampleError: an argument is wrong; names the sample, the argument and the remedy.
        ConfigError: the vocabulary is not known.

    """
    body = (keypoints_3d, landmark_sigma, vertices, faces, template)
    config = config or LabelConfig()
    seen = observe(
        image_hw,
        keypoints_2d,
        *body,
        K,
        pose,
        pose_hypotheses,
        mask,
        vocabulary,
        sample_id,
        config,
        distortion,
    )
    return _labelled([seen], config)[0]


def label_many(
    animals: Iterable[Mapping[str, Any]], config: LabelConfig | None = None
) -> list[CuboidLabel | Rejection]:
    """label_animal for many animals.

    The same labels, cheaper where cameras are known and images have one size.

    Args:
        animals: label_animal's arguments by name, of one animal each, without config. Bodies too
            are cheaper posed many at once (smal.parameters.posed_bodies).
        config: the method.

    Returns:
        Labels and rejections, in order.

    Raises:
        SampleError: an argument is wrong; names the sample, the argument and the remedy.
        ConfigError: a vocabulary is not known.

    """
    config = config or LabelConfig()
    return _labelled(
        [observe(config=config, **{**UNKNOWN, **animal}) for animal in animals], config
    )


def _labelled(animals: Sequence[Observation], config: LabelConfig) -> list[CuboidLabel | Rejection]:
    """What becomes of each animal."""
    prepared = prepare(animals, config)
    ready = [one for one in prepared if isinstance(one, Prepared)]
    labels = iter(
        _unless_degenerate(label, one.seen, config)
        for label, one in zip(assemble_labels(ready), ready, strict=True)
    )
    return [next(labels) if isinstance(one, Prepared) else one for one in prepared]


def _unless_degenerate(
    label: CuboidLabel, seen: Observation, config: LabelConfig
) -> CuboidLabel | Rejection:
    """The label, unless its camera looks away, or is estimated and its projected box far smaller
    than the animal (section 3.2, degenerate)."""
    if label.behind_camera and not bool(label.corner_in_front.any()):
        return Rejection(seen.sample_id, "behind_camera", BEHIND)
    if seen.pose is not None:
        return label
    if seen.mask is not None:
        animal_px = float(np.count_nonzero(seen.mask))
    else:
        keypoints = (
            seen.keypoints_2d[seen.visible, :2]
            if seen.keypoints_2d is not None
            else np.zeros((1, 2))
        )
        animal_px = float((keypoints.max(0) - keypoints.min(0)).prod())
    box_px = float(label.face_area.sum())
    if box_px < config.degenerate_area * animal_px:
        return Rejection(
            seen.sample_id,
            "degenerate_box",
            f"the projected box covers {box_px:.1f} px^2, the animal {animal_px:.0f} px^2",
        )
    return label
