"""The door: one animal from arrays to a label."""

import torch
from torch import Tensor

from animal3dbox.errors import SampleError
from animal3dbox.geometry.cuboid import Cuboid
from animal3dbox.geometry.distortion import beyond_lens
from animal3dbox.labels.assemble import assemble_label, mask_box
from animal3dbox.labels.axes import body_axes
from animal3dbox.labels.bounds import PAPER_MARGIN, tight_cuboid
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.lens import straightened, straightened_box
from animal3dbox.labels.observation import ArrayLike, Observation, observe
from animal3dbox.labels.pose import estimate_pose
from animal3dbox.labels.pose_problem import PoseEstimate, PoseFailure, PoseProblem
from animal3dbox.labels.shown_body import shown_body
from animal3dbox.labels.types import CuboidLabel, Rejection
from animal3dbox.labels.uncertainty import keypoint_sigma, misfit_sigma
from animal3dbox.smal.model import SmalModel
from animal3dbox.smal.vocabulary import Vocabulary


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
        keypoints_2d: (J, 3) x, y in px and visibility (0 hidden or missing, else a confidence in (0, 1]).
        keypoints_3d: (J, 3) the same landmarks on the body, in the mesh's own frame and unit; NaN where it has none.
            Read off the template's vertex groups if left out.
        vertices: (V, 3) the posed mesh, same frame; without it the box bounds the landmarks, and the label says so.
        faces: (F, 3) its triangles, for the overlap with the mask.
        template: the body template that the vertices correspond to one to one, if any.
        K: (3, 3) in px; None: guessed (LabelConfig.focal_guess), and the label says so.
        pose: (R, t) known exactly, X_cam = R X + t: no keypoints needed, no PnP.
        pose_hypotheses: further (R, t) to start from.
        mask: (H, W), above 0 on the animal.
        vocabulary: the keypoints' names: a known vocabulary or your own.
        sample_id: named in every error.
        config: the method.
        landmark_sigma: (J,) how far each landmark may be from where the body has it, in the mesh's unit, for a body that is
            not in the animal's pose; None: the body is. Used by method "default".
        distortion: (4,), (5,), (8,) or (12,) coefficients of OpenCV's lens, k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4]]]; None:
            the picture has none. Pixels, of keypoints and mask as of the label, are the distorted picture's. The pose is
            solved for the keypoints and the mask's outline as they would be without the lens; a box that reaches beyond
            the lens's field of view is rejected.

    Returns:
        A label, or a rejection with its reason.

    Raises:
        SampleError: an argument is wrong; names the sample, the argument and the remedy.
        ConfigError: the vocabulary is not known.

    """
    config = config or LabelConfig()
    body = (keypoints_3d, landmark_sigma, vertices, faces, template)
    seen = observe(image_hw, keypoints_2d, *body, K, pose, pose_hypotheses, mask, vocabulary, sample_id, config, distortion)
    if config.axes == "pca" and seen.vertices is None and not bool(seen.has_landmark.any()):
        return Rejection(sample_id, "no_axes", "there are neither vertices nor landmarks")
    axes = body_axes(seen, config.axes)
    if axes is None:
        return Rejection(sample_id, "no_axes", "the landmarks known do not fix forward and left; give a template or more of the trunk's landmarks")
    cuboid_mesh, bounds_source, warnings = _cuboid_of_body(seen, axes.R_box, config)
    estimate: PoseEstimate | PoseFailure
    if seen.pose is not None:
        estimate = seen.pose
    else:
        problem, lens_warnings = _pose_problem(seen, axes.R_box, config)
        estimate = estimate_pose(problem, config, seen.hypotheses)
        warnings += lens_warnings
    if isinstance(estimate, PoseFailure):
        return Rejection(sample_id, estimate.reason, estimate.detail)
    if seen.distortion is not None:
        corners = cuboid_mesh.corners()
        outline = corners if seen.vertices is None else torch.cat((corners, seen.vertices))
        if bool(beyond_lens(seen.distortion, outline @ estimate.R.mT + estimate.t)):
            return Rejection(sample_id, "beyond_lens", "the animal or its box reaches beyond the lens's field of view, where its polynomial folds")
    warnings = (*seen.warnings, *warnings, *estimate.warnings)
    label = assemble_label(seen, cuboid_mesh, estimate, shown_body(seen, estimate, axes.R_box, config), axes.rule, bounds_source, warnings)
    return label if seen.pose is not None else _unless_degenerate(label, seen, config)


def _cuboid_of_body(seen: Observation, R_box: Tensor, config: LabelConfig) -> tuple[Cuboid, str, tuple[str, ...]]:
    """The tight box in the mesh's frame, what it bounds, and warnings."""
    margin = config.margin if config.margin is not None else (None if config.method == "default" else PAPER_MARGIN)
    if seen.vertices is None:
        box = tight_cuboid(seen.known_landmarks, R_box, margin)
        return box, "keypoints", ("no mesh: the box bounds the landmarks, which lie inside the animal's outline",)
    if config.tail == "keep":
        return tight_cuboid(seen.vertices, R_box, margin), "vertices", ()
    if seen.template is None:
        raise SampleError(seen.sample_id, "template", "is missing, but tail='drop' needs it to know which vertices are the tail's")
    kept = torch.ones(len(seen.vertices), dtype=torch.bool)
    kept[seen.template.tail_vertices] = False
    return tight_cuboid(seen.vertices[kept], R_box, margin), "vertices", ()


def _pose_problem(seen: Observation, R_box: Tensor, config: LabelConfig) -> tuple[PoseProblem, tuple[str, ...]]:
    """The visible keypoints with their landmarks, as a pinhole would show them, and warnings; none at all if either side is missing."""
    used = seen.matched
    empty = torch.zeros((0, 3), dtype=torch.float64)  # nothing to solve for: the pose is given, or there is a rejection
    points = seen.landmarks[used] if seen.landmarks is not None else empty
    keypoints = seen.keypoints_2d[used] if seen.keypoints_2d is not None else empty
    sigma = keypoint_sigma(keypoints, seen.image_hw, config)
    pixels, box, warnings = keypoints[:, :2], None if seen.mask is None else mask_box(seen.mask), list[str]()
    misfit = seen.landmark_sigma[used]
    if seen.distortion is not None:
        pixels, stretched, found = straightened(pixels, seen.K, seen.distortion)
        if not bool(found.all()):
            warnings = [f"{int((~found).sum())} keypoints lie where the lens shows nothing and do not count for the pose"]
        points, pixels, sigma, misfit = points[found], pixels[found], (sigma * stretched)[found], misfit[found]
        box = None if seen.mask is None else straightened_box(seen.mask, seen.K, seen.distortion)
    if config.method == "default":
        sigma = torch.hypot(sigma, misfit_sigma(points, pixels, misfit))
    return PoseProblem(points, pixels, sigma, seen.K, seen.image_hw, R_box, seen.vertices, box), tuple(warnings)


def _unless_degenerate(label: CuboidLabel, seen: Observation, config: LabelConfig) -> CuboidLabel | Rejection:
    """The label, unless its projected box is far smaller than the animal (section 3.2, degenerate)."""
    if seen.mask is not None:
        animal_px = float(seen.mask.sum())
    else:
        keypoints = seen.keypoints_2d[seen.visible, :2] if seen.keypoints_2d is not None else torch.zeros((1, 2))
        animal_px = float((keypoints.amax(0) - keypoints.amin(0)).prod())
    box_px = float(label.face_area.sum())
    if box_px < config.degenerate_area * animal_px:
        return Rejection(seen.sample_id, "degenerate_box", f"the projected box covers {box_px:.1f} px^2, the animal {animal_px:.0f} px^2")
    return label
