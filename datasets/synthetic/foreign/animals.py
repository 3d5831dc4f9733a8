"""Animals of a foreign world before a camera: what is true, and what a dataset would say."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch
from torch import Tensor

from animal3dbox.datasets.synthetic.faults import faulty_keypoints, resized_mask, swapped_keypoints
from animal3dbox.datasets.synthetic.foreign.bodies import (
    PART_SPREAD,
    merged_mesh,
    part_scales,
    stretched_model,
)
from animal3dbox.datasets.synthetic.foreign.config import (
    OTHER_POSES,
    STANDING_POSES,
    ForeignConfig,
)
from animal3dbox.datasets.synthetic.foreign.masks import (
    occluding_thing,
    supersampled_mask,
    worn_mask,
)
from animal3dbox.datasets.synthetic.foreign.parts import model_of_parts
from animal3dbox.datasets.synthetic.foreign.places import (
    carried_places,
    drawn_offsets,
    template_places,
)
from animal3dbox.datasets.synthetic.scenes import exact_keypoints
from animal3dbox.datasets.synthetic.world.animals import draw_betas, draw_pose
from animal3dbox.datasets.synthetic.world.cameras import draw_camera
from animal3dbox.datasets.synthetic.world.config import world_generator
from animal3dbox.geometry.camera import PinholeCamera
from animal3dbox.geometry.cuboid import Cuboid
from animal3dbox.geometry.rigid_transforms import (
    axis_angle_from_rotation,
    rotation_from_axis_angle,
    transform_points,
)
from animal3dbox.labels.bounds import tight_cuboid
from animal3dbox.labels.visibility.visible_keypoints import visible_keypoints
from animal3dbox.smal.keypoints.vocabulary import Vocabulary
from animal3dbox.smal.linear_blend_skinning import PosedBody
from animal3dbox.smal.model import SmalModel, trunk_rotation
from animal3dbox.smal.quadruped.poses import ground_trans
from animal3dbox.smal.quadruped.preset_bodies import (
    load_quadruped,
    preset_betas,
    quadruped_names,
)


@dataclass(frozen=True, eq=False)
class ForeignAnimal:
    """One animal of a foreign world; float64, in a world with z up.

    Attributes:
        sample_id: species, pose, seed and index.
        preset: the species whose shape was stretched.
        pose: the pose's name; "side <pose>" of one that lies on its side.
        vocabulary: names of the J keypoints.
        camera: in the world.
        model: the body's own, without shape columns.
        body: the posed one.
        landmarks: (J, 3) the keypoints' true places; NaN where the body has none.
        exact: (J, 3) exact keypoints: x, y px and 1, or zeros outside the frame.
        keypoints_2d: (J, 3) as the dataset has them.
        mask: (H, W) bool as the dataset has it.
        fitted: vertices (V, 3) and landmarks (J, 3) of the body that the dataset gives, in the
            world.
    """

    sample_id: str
    preset: str
    pose: str
    vocabulary: Vocabulary
    camera: PinholeCamera
    model: SmalModel
    body: PosedBody
    landmarks: Tensor
    exact: Tensor
    keypoints_2d: Tensor
    mask: Tensor
    fitted: tuple[Tensor, Tensor]

    @property
    def trunk(self) -> Tensor:
        """Rotation (3, 3) R_world_box of the trunk, from the spine's joints."""
        return trunk_rotation(self.body.R_world_joint[0])

    @property
    def vertices(self) -> Tensor:
        """The body's vertices (V, 3) in the world."""
        return self.body.vertices[0]

    @cached_property
    def cuboid(self) -> Cuboid:
        """The tight box along the trunk, in the camera frame."""
        return tight_cuboid(self.vertices, self.trunk).transformed(self.camera.T_cam_world)

    @property
    def camera_in_trunk(self) -> Tensor:
        """Where the camera stands seen from the box's centre, in the trunk's axes, (3,)."""
        return -self.cuboid.rotation.mT @ self.cuboid.center

    def arguments(self, *, template: bool = False, cell: float = 0.0) -> dict[str, Any]:
        """label_animal's arguments for the body that the dataset gives, by name.

        Args:
            template: whether it comes with its model; the vertices then correspond to it, and
                landmarks are the moved ones all the same.
            cell: of merged_mesh, for a body that comes without.

        """
        (vertices, landmarks), faces = self.fitted, self.model.faces
        if cell:
            vertices, faces = merged_mesh(vertices, faces, cell)
        return {
            "image_hw": self.camera.image_hw,
            "keypoints_2d": self.keypoints_2d,
            "keypoints_3d": landmarks,
            "vertices": vertices,
            "faces": faces,
            "template": self.model if template else None,
            "K": self.camera.K,
            "mask": self.mask,
            "vocabulary": self.vocabulary,
            "sample_id": self.sample_id,
        }


def foreign_animal(
    seed: int, index: int, config: ForeignConfig | None = None, *, dataset: int | None = None
) -> ForeignAnimal:
    """The animal of a seed and an index.

    Args:
        seed: of the world.
        index: of the animal.
        config: the dials.
        dataset: number of the dataset, whose keypoint places and classes it shares; None: it is
            alone in one.

    Example:
        >>> animal = foreign_animal(0, 0)
        >>> animal.sample_id, animal.keypoints_2d.shape
        ('dog-head_turned-0-0', torch.Size([26, 3]))
    """
    config = config or ForeignConfig()
    rng = {
        part: world_generator(seed, index, f"foreign-{part}")
        for part in ("shape", "pose", "places", "camera", "mask", "fit", "surface", "occluder")
    }
    own_dataset = index if dataset is None else dataset
    preset, model = _drawn_body(rng, seed, index, dataset=own_dataset, config=config)
    name, pose = _drawn_pose(rng["pose"], config)
    body = _on_the_ground(model, pose)
    vocabulary = config.world.vocabulary
    offsets = _offsets(seed, own_dataset, rng["places"], config)
    places = template_places(model, vocabulary, offsets, config)
    landmarks = carried_places(model, vocabulary, places, body)
    camera = draw_camera(rng["camera"], body.vertices[0], config.world)
    sample_id = f"{preset}-{name}-{seed}-{index}".replace(" ", "-")
    exact, keypoints = _keypoints(
        sample_id,
        seed,
        model=model,
        body=body,
        landmarks=landmarks,
        camera=camera,
        config=config,
    )
    mask = _mask(rng["mask"], model=model, body=body, camera=camera, config=config)
    keypoints, mask = _behind_a_thing(keypoints, mask, rng["occluder"], config)
    return ForeignAnimal(
        sample_id=sample_id,
        preset=preset,
        pose=name,
        vocabulary=vocabulary,
        camera=camera,
        model=model,
        body=body,
        landmarks=landmarks,
        exact=exact,
        keypoints_2d=keypoints,
        mask=mask,
        fitted=_fitted(rng["fit"], model=model, pose=pose, body=body, places=places, config=config),
    )


def _drawn_body(
    rng: Mapping[str, np.random.Generator],
    seed: int,
    index: int,
    *,
    dataset: int,
    config: ForeignConfig,
) -> tuple[str, SmalModel]:
    """A species, and its model with parts stretched, its surface or another."""
    presets = config.world.presets or quadruped_names().presets
    preset = presets[index % len(presets)]
    betas, scales = _drawn_shape(rng["shape"], seed, preset, dataset=dataset, config=config)
    model = stretched_model(load_quadruped(), betas, scales)
    return preset, model_of_parts(model, rng["surface"]) if config.surface == "parts" else model


def _drawn_shape(
    rng: np.random.Generator, seed: int, preset: str, *, dataset: int, config: ForeignConfig
) -> tuple[Tensor, dict[str, float]]:
    """The betas and the factors of measures of an animal of a dataset's class."""
    spread, proportions = config.world.shape_spread, config.proportions
    if config.individual == 1:
        return draw_betas(rng, preset, spread), part_scales(rng, proportions)
    of_class = world_generator(seed, dataset, f"foreign-class-{preset}")
    betas, scales = draw_betas(of_class, preset, spread), part_scales(of_class, proportions)
    betas = betas + draw_betas(rng, preset, config.individual * spread) - preset_betas(preset)
    own = part_scales(rng, config.individual * proportions)
    return betas, {name: scale * own[name] for name, scale in scales.items()}


def _drawn_pose(rng: np.random.Generator, config: ForeignConfig) -> tuple[str, Tensor]:
    """A pose's name and the pose (J, 3), its heading and side within the root's."""
    usual = STANDING_POSES if rng.random() < config.standing else OTHER_POSES
    names = config.poses or usual
    name = names[int(rng.integers(len(names)))]
    pose = draw_pose(rng, name, config.world.pose_spread)
    heading = torch.tensor([0.0, 0.0, rng.uniform(-np.pi, np.pi)], dtype=torch.float64)
    root = rotation_from_axis_angle(pose[0])
    side = rng.uniform(70, 100) * (1 if rng.random() < 0.5 else -1)
    if rng.random() < config.lying:
        name = f"side {name}"
        fall = torch.tensor([np.deg2rad(side), 0.0, 0.0], dtype=torch.float64)
        root = rotation_from_axis_angle(fall) @ root
    root = rotation_from_axis_angle(heading) @ root
    joints = pose[1:]
    if config.joints_deg:
        turns = torch.from_numpy(rng.standard_normal(joints.shape))
        joints = joints + np.deg2rad(config.joints_deg) * turns
    return name, torch.cat((axis_angle_from_rotation(root)[None], joints))


def _on_the_ground(model: SmalModel, pose: Tensor) -> PosedBody:
    """The posed body, its lowest vertex on the ground."""
    betas, origin = torch.zeros(1, 0, dtype=torch.float64), torch.zeros(1, 3, dtype=torch.float64)
    trans = ground_trans(model.posed(betas, pose[None], origin).vertices)
    return model.posed(betas, pose[None], trans)


def _offsets(seed: int, dataset: int, rng: np.random.Generator, config: ForeignConfig) -> Tensor:
    """The keypoints' offsets (J, 3) from the quadruped's places, as parts of the trunk's length."""
    vocabulary = config.world.vocabulary
    shared = world_generator(seed, dataset, "foreign-dataset")
    return config.places * drawn_offsets(shared, vocabulary) + config.places_of_animal * (
        drawn_offsets(rng, vocabulary)
    )


def _keypoints(
    sample_id: str,
    seed: int,
    *,
    model: SmalModel,
    body: PosedBody,
    landmarks: Tensor,
    camera: PinholeCamera,
    config: ForeignConfig,
) -> tuple[Tensor, Tensor]:
    """The exact keypoints (J, 3), and as the dataset has them: hidden ones are not marked."""
    T = camera.T_cam_world
    vocabulary = config.world.vocabulary
    exact = exact_keypoints(landmarks, camera.K, T[:3, :3], T[:3, 3], image_hw=camera.image_hw)
    seen = visible_keypoints(
        vocabulary,
        model.landmark_groups,
        transform_points(T, body.vertices[0]),
        model.faces,
        K=camera.K,
        image_hw=camera.image_hw,
    )
    marked = exact.clone()
    marked[~seen, 2] = 0.0
    marked = swapped_keypoints(sample_id, vocabulary, marked, faults=config.faults, seed=seed)
    return exact, faulty_keypoints(
        sample_id, camera.image_hw, marked, faults=config.faults, seed=seed
    )


def _mask(
    rng: np.random.Generator,
    *,
    model: SmalModel,
    body: PosedBody,
    camera: PinholeCamera,
    config: ForeignConfig,
) -> Tensor:
    """The mask (H, W) as the dataset has it."""
    vertices_cam = transform_points(camera.T_cam_world, body.vertices[0])
    drawn = supersampled_mask(vertices_cam, model.faces, camera.K, camera.image_hw)
    holes = rng.random() < config.mask_holes
    worn = worn_mask(drawn, rng, jitter_px=config.mask_jitter_px, holes=holes)
    return resized_mask(worn, config.faults.mask_px)


def _behind_a_thing(
    keypoints: Tensor, mask: Tensor, rng: np.random.Generator, config: ForeignConfig
) -> tuple[Tensor, Tensor]:
    """Keypoints (J, 3) and mask (H, W) of an animal before which something may stand."""
    if rng.random() >= config.occluded:
        return keypoints, mask
    thing = torch.from_numpy(occluding_thing(mask.numpy(), rng))
    height, width = mask.shape
    x = keypoints[:, 0].round().long().clamp(0, width - 1)
    y = keypoints[:, 1].round().long().clamp(0, height - 1)
    seen = keypoints * ~thing[y, x, None]
    return seen, mask & ~thing


def _fitted(
    rng: np.random.Generator,
    *,
    model: SmalModel,
    pose: Tensor,
    body: PosedBody,
    places: Tensor,
    config: ForeignConfig,
) -> tuple[Tensor, Tensor]:
    """Vertices (V, 3) and landmarks (J, 3) of the body that the dataset gives, in the world.

    Its joints are off by faults.joint_deg and its measures by the stature; its root joint stays.
    """
    turns = torch.from_numpy(rng.standard_normal(pose[1:].shape))
    bent = torch.cat((pose[:1], pose[1:] + np.deg2rad(config.faults.joint_deg) * turns))
    draws = rng.standard_normal(len(PART_SPREAD))
    scales = {
        name: float(np.exp(config.stature * draw))
        for name, draw in zip(PART_SPREAD, draws, strict=True)
    }
    no_betas = torch.zeros(0, dtype=torch.float64)
    other = stretched_model(model, no_betas, scales) if config.stature else model
    posed = other.posed(no_betas[None], bent[None], torch.zeros(1, 3, dtype=torch.float64))
    shift = body.joints[:, 0] - posed.joints[:, 0]
    posed = PosedBody(
        posed.vertices + shift[:, None], posed.joints + shift[:, None], posed.R_world_joint
    )
    moved = places + (
        config.world.vocabulary.on_body(other.landmark_groups, other.v_template)
        - config.world.vocabulary.on_body(model.landmark_groups, model.v_template)
    )
    return posed.vertices[0], carried_places(other, config.world.vocabulary, moved, posed)
