"""What the articulated fit gives: a posed body before its camera, and how sure of it it is."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.labels.fit_parameters import FitParameters
from animal3dbox.smal.keypoints.vocabulary import Vocabulary
from animal3dbox.smal.model import SmalModel

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FitHypothesis:
    """One orientation that was considered.

    Attributes:
        rotation: (3, 3) R_cam_box of the trunk.
        score: what it costs in all, in halves of a squared standard deviation.
        labeling: "as given", or "all" where left and right are exchanged.

    Example:
        >>> FitHypothesis(np.eye(3), 12.5, "as given").score
        12.5
    """

    rotation: Array
    score: float
    labeling: str


@dataclass(frozen=True, eq=False)
class FittedBody:
    """A body fitted to one animal's picture: X_cam = R v + t for its vertices v.

    The overall size is not observable: a body twice as large and twice as far looks the same.

    Attributes:
        sample_id: the caller's name for the sample.
        model: the body's model.
        body_name: what the body is called: "quadruped", "quadruped:<species>" or "model".
        vocabulary: names of the J keypoints.
        betas: (S,) shape.
        pose: (joints, 3) axis-angle in radians; the root's is zero, the camera carries it.
        vertices: (V, 3) posed with the pose's correctives, in the model's frame and unit.
        R_world_joint: (joints, 3, 3) global rotations of the joints in that frame.
        R: (3, 3) R_cam_world, world being the model's frame.
        t: (3,) t_cam_world.
        K: (3, 3) as given, or with the estimated focal length.
        K_source: "given" or "estimated".
        log_focal: natural logarithm of the estimated focal length by the guessed one; 0 if given.
        log_focal_sd: its standard deviation; None if the focal length was given.
        R_box: (3, 3) R_world_box of the trunk.
        rotation_covariance: (3, 3) rad^2, of a turn of the trunk about the camera's axes.
        cost: of the descent, in halves of a squared standard deviation.
        margin: what the best hypothesis of another orientation or labeling costs more; None if
            there was none.
        labeling: "as given", or "all" where left and right keypoints were exchanged and are mended.
        misfit: how many times larger the keypoints' distances are than their noise, at least 1.
        hidden: part of the marked keypoints whose surface is turned away from the camera.
        moved_places: (J, 3) how far the keypoints' places, as a calibration has them, lie on the
            posed body from the model's own; 0 without.
        calibration: digest of the calibration that had a part in the fit; None without.
        hypotheses: all that were considered, the one taken first.

    Example:
        >>> from animal3dbox import fit_animal
        >>> from animal3dbox.datasets.synthetic import synthetic_animal
        >>> animal = synthetic_animal(seed=0, index=2)
        >>> fit = fit_animal(animal.image_hw, animal.keypoints_2d, K=animal.K)
        >>> fit.labeling, fit.rotation_sd_deg < 10
        ('as given', True)
    """

    sample_id: str | None
    model: SmalModel
    body_name: str
    vocabulary: Vocabulary
    betas: Array
    pose: Array
    vertices: Array
    R_world_joint: Array
    R: Array
    t: Array
    K: Array
    K_source: str
    log_focal: float
    log_focal_sd: float | None
    R_box: Array
    rotation_covariance: Array
    cost: float
    margin: float | None
    labeling: str
    misfit: float
    hidden: float
    moved_places: Array
    calibration: str | None
    hypotheses: tuple[FitHypothesis, ...]

    @property
    def faces(self) -> NDArray[np.int64]:
        """The triangles (F, 3) between the vertices."""
        faces: NDArray[np.int64] = as_numpy(self.model.faces)
        return faces

    @property
    def parameters(self) -> FitParameters:
        """What poses the body again, as labels keep it."""
        return FitParameters(
            self.body_name, self.model.digest, self.vocabulary.name, self.betas, self.pose
        )

    @property
    def landmarks(self) -> Array:
        """The keypoints (J, 3) on the body; NaN for those that it has no place for."""
        own: Array = self.model.read_keypoints(self.vocabulary, self.vertices)
        landmarks: Array = own + self.moved_places
        return landmarks

    @property
    def vertices_cam(self) -> Array:
        """The vertices (V, 3) in the camera frame."""
        vertices: Array = self.vertices @ self.R.T + self.t
        return vertices

    @property
    def rotation(self) -> Array:
        """R_cam_box (3, 3) of the trunk: columns forward, left, up."""
        rotation: Array = self.R @ self.R_box
        return rotation

    @property
    def rotation_sd_deg(self) -> float:
        """Standard deviation of the trunk's rotation, in degrees, about its least certain axis."""
        return float(np.degrees(np.sqrt(np.linalg.eigvalsh(self.rotation_covariance)[-1])))
