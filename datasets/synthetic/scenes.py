"""Scenes of a synthetic world: a picture, its animals, and everything that is true of them.

The same (seed, index, config) gives the same scene to the byte, whatever else was drawn before.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import torch
from torch import Tensor

from animal3dbox.datasets.synthetic.world.animals import StandingAnimal
from animal3dbox.datasets.synthetic.world.config import CLEAR, WorldConfig
from animal3dbox.datasets.synthetic.world.render import render_scene, surfaces_of
from animal3dbox.datasets.synthetic.world.scene import ScenePlan, plan_scene
from animal3dbox.datasets.synthetic.world.shading import joined_meshes
from animal3dbox.geometry.box_visibility import FaceVisibility, face_visibility
from animal3dbox.geometry.camera import PinholeCamera, project
from animal3dbox.geometry.cuboid import Cuboid
from animal3dbox.geometry.rasterizer import silhouette
from animal3dbox.geometry.rigid_transforms import transform_points
from animal3dbox.geometry.visible_surface import surface_share
from animal3dbox.labels.bounds import tight_cuboid
from animal3dbox.labels.visibility.visible_keypoints import visible_keypoints
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES
from animal3dbox.smal.keypoints.vocabulary import Vocabulary
from animal3dbox.smal.model import SmalModel, trunk_rotation
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped

LEAST_PIXELS = 60
"""Visible pixels that an animal beside the first needs to be annotated.

Nobody would mark a smaller one, which is part of the picture only. The first animal needs one.
"""


@dataclass(frozen=True)
class SceneMesh:
    """The mesh of everything in a scene that can hide something.

    Attributes:
        vertices_cam: (V, 3) camera frame, the animals' vertices first.
        faces: (F, 3).
    """

    vertices_cam: Tensor
    faces: Tensor


@dataclass(frozen=True, eq=False)
class SyntheticAnimal:
    """One posed quadruped in a picture, and everything that is true of it; float64.

    The world has its z up, and its unit is the body's: about one from nose to rump.

    Attributes:
        sample_id: preset, pose and the scene's index; "#k" for the animals after the first.
        image: (H, W, 3) uint8 RGB, of the whole scene.
        mask: (H, W) bool, the animal's visible pixels (modal).
        vertices: (V, 3) world.
        R_world_joint: (J, 3, 3) global rotations of the skeleton's joints.
        model: the body's template.
        vocabulary: names of the keypoints.
        camera: the scene's camera.
        scene: the mesh of everything that may hide the animal.
        number: the animal's place among the scene's animals.
        parameters: betas (S,), pose (J, 3) and trans (3,) that pose the model into vertices.
        preset: the species.
        pose: the pose's name.

    Example:
        >>> animal = synthetic_animal(0, 0, (120, 160), preset="dog", pose="stand")
        >>> animal.sample_id, round(float(animal.faces_seen.share.sum()), 6)
        ('dog-stand-0', 1.0)

    """

    sample_id: str
    image: Tensor
    mask: Tensor
    vertices: Tensor
    R_world_joint: Tensor
    model: SmalModel
    vocabulary: Vocabulary
    camera: PinholeCamera
    scene: SceneMesh
    number: int
    parameters: tuple[Tensor, Tensor, Tensor]
    preset: str
    pose: str

    @property
    def image_hw(self) -> tuple[int, int]:
        """Height and width of the picture."""
        return self.camera.image_hw

    @property
    def K(self) -> Tensor:
        """Intrinsics (3, 3) of the scene's camera, in px."""
        return self.camera.K

    @property
    def R(self) -> Tensor:
        """Rotation (3, 3) R_cam_world of the scene's camera."""
        return self.camera.T_cam_world[:3, :3]

    @property
    def t(self) -> Tensor:
        """Translation (3,) t_cam_world of the scene's camera."""
        return self.camera.T_cam_world[:3, 3]

    @property
    def vertices_cam(self) -> Tensor:
        """The body's vertices (V, 3) in the camera frame."""
        return transform_points(self.camera.T_cam_world, self.vertices)

    @cached_property
    def landmarks(self) -> Tensor:
        """Places (J, 3) of the keypoints in the world; NaN where the body has none."""
        return self.vocabulary.on_body(self.model.landmark_groups, self.vertices)

    @cached_property
    def keypoints_2d(self) -> Tensor:
        """Exact keypoints (J, 3): x, y px and 1, or zeros outside the frame; hidden or not."""
        return exact_keypoints(self.landmarks, self.K, self.R, self.t, image_hw=self.image_hw)

    @cached_property
    def keypoint_visible(self) -> Tensor:
        """Whether each keypoint is in the frame and hidden by nothing, (J,) bool.

        Rays from its vertices to the camera tell.
        """
        span = (self.number * self.model.vertex_count, (self.number + 1) * self.model.vertex_count)
        not_hidden = visible_keypoints(
            self.vocabulary,
            self.model.landmark_groups,
            self.scene.vertices_cam,
            self.scene.faces,
            K=self.K,
            image_hw=self.image_hw,
            body=span,
        )
        return not_hidden & (self.keypoints_2d[:, 2] > 0)

    @cached_property
    def amodal_mask(self) -> Tensor:
        """Silhouette (H, W) bool inside the frame, as if nothing stood before the animal."""
        return silhouette(self.vertices_cam, self.model.faces, self.K, self.image_hw)

    @property
    def trunk(self) -> Tensor:
        """Rotation (3, 3) R_world_box of the trunk, from the spine's joints."""
        return trunk_rotation(self.R_world_joint)

    @cached_property
    def cuboid_world(self) -> Cuboid:
        """The tight box along the trunk, in the world."""
        return tight_cuboid(self.vertices, self.trunk)

    @cached_property
    def cuboid(self) -> Cuboid:
        """The tight box along the trunk, in the camera frame."""
        return self.cuboid_world.transformed(self.camera.T_cam_world)

    @cached_property
    def faces_seen(self) -> FaceVisibility[Tensor]:
        """Visibility and shares of the box's faces in the scene's camera."""
        return face_visibility(self.cuboid, self.K, self.image_hw)

    @cached_property
    def surface_share(self) -> Tensor:
        """Parts (6,) of the animal's own surface in the frame by the side that it faces.

        Things that stand before the animal do not count.
        """
        return surface_share(
            self.vertices_cam,
            self.model.faces,
            self.cuboid.rotation,
            K=self.K,
            image_hw=self.image_hw,
        )

    @property
    def visible_part(self) -> float:
        """Part of the silhouette in the frame that nothing hides, 0 to 1."""
        return float(self.mask.sum()) / max(float(self.amodal_mask.sum()), 1.0)


@dataclass(frozen=True, eq=False)
class SyntheticScene:
    """One picture of a synthetic world with its animals and its camera.

    Attributes:
        image_id: seed and index.
        image: (H, W, 3) uint8 RGB.
        camera: in the world.
        animals: the visible ones, nearest to the camera's aim first; none if the only one is wholly
            hidden, or too small to fill a pixel.
        owner: (H, W) int64, the number of the animal at each pixel's centre; numbers from
            len(plan.animals) on are things, -1 background.
        plan: the scene before it was rendered.

    Example:
        >>> scene = synthetic_scene(0, 0, WorldConfig(image_hw=(120, 160), animals=(1, 1)))
        >>> scene.image_id, tuple(scene.image.shape), len(scene.animals)
        ('0-000000', (120, 160, 3), 1)

    """

    image_id: str
    image: Tensor
    camera: PinholeCamera
    animals: tuple[SyntheticAnimal, ...]
    owner: Tensor
    plan: ScenePlan


def synthetic_scene(seed: int, index: int, config: WorldConfig | None = None) -> SyntheticScene:
    """The scene of a seed and an index; raises ConfigError if one of them is negative.

    Args:
        seed: of the world.
        index: of the scene.
        config: of the world; None: the default.

    Example:
        >>> synthetic_scene(0, 4, WorldConfig(image_hw=(120, 160))).image_id
        '0-000004'

    """
    config = config or WorldConfig()
    plan = plan_scene(seed, index, config)
    picture = render_scene(plan)
    vertices, faces, _ = joined_meshes(surfaces_of(plan))
    mesh = SceneMesh(transform_points(plan.camera.T_cam_world, vertices), faces)
    animals = []
    for number, animal in enumerate(plan.animals):
        mask = picture.owner == number
        if int(mask.sum()) >= (1 if number == 0 else LEAST_PIXELS):
            animals.append(
                _animal(
                    animal,
                    number,
                    plan,
                    config.vocabulary,
                    image=picture.image,
                    mask=mask,
                    mesh=mesh,
                )
            )
    return SyntheticScene(
        image_id=f"{seed}-{index:06d}",
        image=picture.image,
        camera=plan.camera,
        animals=tuple(animals),
        owner=picture.owner,
        plan=plan,
    )


def synthetic_animal(
    seed: int,
    index: int,
    image_hw: tuple[int, int] = (480, 640),
    *,
    vocabulary: Vocabulary = VOCABULARIES["animal3d26"],
    preset: str | None = None,
    pose: str | None = None,
) -> SyntheticAnimal:
    """A quadruped in a random pose and view, whole and in full view, for examples and tests.

    It is the only animal of a scene with the config CLEAR.

    Args:
        seed: of the world, not negative.
        index: of the animal among the seed's.
        image_hw: height and width; the focal length is 0.9 to 2.5 times the longer side.
        vocabulary: names of the keypoints.
        preset: the species; None: the presets in turn.
        pose: one of POSES; None: a random one of them.

    Example:
        >>> animal = synthetic_animal(0, 3, (120, 160), preset="horse", pose="trot")
        >>> animal.sample_id, animal.keypoints_2d.shape
        ('horse-trot-3', torch.Size([26, 3]))

    """
    config = replace(
        CLEAR,
        image_hw=image_hw,
        vocabulary=vocabulary,
        presets=() if preset is None else (preset,),
        poses=CLEAR.poses if pose is None else (pose,),
        focal_px=(0.9 * max(image_hw), 2.5 * max(image_hw)),
    )
    return synthetic_scene(seed, index, config).animals[0]


def exact_keypoints(
    landmarks: Tensor, K: Tensor, R: Tensor, t: Tensor, *, image_hw: tuple[int, int]
) -> Tensor:
    """The projections of landmarks as keypoints, whether or not something hides them.

    Args:
        landmarks: (J, 3) world; NaN where the body has none.
        K: (3, 3) in px.
        R: (3, 3) R_cam_world.
        t: (3,) t_cam_world.
        image_hw: height and width.

    Returns:
        (J, 3) x, y px and 1, or zeros outside the frame and where the body has none.

    """
    px, depth = project(K, landmarks @ R.mT + t)
    height, width = image_hw
    inside = (
        (depth > 0) & (px >= -0.5).all(-1) & (px[:, 0] < width - 0.5) & (px[:, 1] < height - 0.5)
    )
    keypoints = torch.cat((px, torch.ones_like(px[:, :1])), dim=1)
    return torch.where(inside[:, None], keypoints, torch.zeros_like(keypoints))


def _animal(
    animal: StandingAnimal,
    number: int,
    plan: ScenePlan,
    vocabulary: Vocabulary,
    *,
    image: Tensor,
    mask: Tensor,
    mesh: SceneMesh,
) -> SyntheticAnimal:
    """The truth of one animal of a plan, whose scene has been rendered."""
    return SyntheticAnimal(
        sample_id=f"{animal.preset}-{animal.pose_name}-{plan.index}"
        + (f"#{number}" if number else ""),
        image=image,
        mask=mask,
        vertices=animal.vertices,
        R_world_joint=animal.R_world_joint,
        model=load_quadruped(),
        vocabulary=vocabulary,
        camera=plan.camera,
        scene=mesh,
        number=number,
        parameters=(animal.betas, animal.pose, animal.trans),
        preset=animal.preset,
        pose=animal.pose_name,
    )
