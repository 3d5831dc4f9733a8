from dataclasses import replace

import torch
from torch.testing import assert_close

from animal3dbox.datasets import SyntheticDataset, SyntheticSet
from animal3dbox.datasets.bodies.sources import BREED, model_mobility
from animal3dbox.datasets.synthetic.scenes import synthetic_animal, synthetic_scene
from animal3dbox.datasets.synthetic.world.config import WorldConfig
from animal3dbox.datasets.synthetic.world.shading import (
    Light,
    Surface,
    render,
    shade,
    vertex_normals,
)
from animal3dbox.geometry.camera import PinholeCamera, intrinsics
from animal3dbox.geometry.rigid_transforms import rigid, transform_points
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, preset_betas

F64 = torch.float64
SMALL = (120, 160)


def test_the_same_seed_and_index_give_the_same_animal_and_others_another() -> None:
    a, b, c = (
        synthetic_animal(3, 1, SMALL),
        synthetic_animal(3, 1, SMALL),
        synthetic_animal(4, 1, SMALL),
    )
    assert torch.equal(a.image, b.image)
    assert torch.equal(a.keypoints_2d, b.keypoints_2d)
    assert not torch.equal(a.R, c.R)


def test_keypoints_are_the_projected_landmarks_and_lie_on_or_near_the_animal() -> None:
    for index in range(5):
        animal = synthetic_animal(0, index, SMALL)
        cam = transform_points(rigid(animal.R, animal.t), animal.landmarks)
        px = (cam @ animal.K.mT)[:, :2] / cam[:, 2:]
        seen = animal.keypoints_2d[:, 2] > 0
        assert int(seen.sum()) == 26
        assert_close(animal.keypoints_2d[seen, :2], px[seen])
        columns, rows = px.round().long().unbind(1)
        grown = (
            torch.nn.functional.max_pool2d(animal.amodal_mask[None, None].double(), 5, 1, 2)[0, 0]
            > 0
        )
        assert bool(grown[rows, columns].all())


def test_the_animal_stands_within_the_frame_and_is_not_the_background() -> None:
    animal = synthetic_animal(1, 2, SMALL)
    assert abs(float(animal.vertices[:, 2].amin())) < 1e-12
    border = torch.cat((animal.mask[0], animal.mask[-1], animal.mask[:, 0], animal.mask[:, -1]))
    assert not border.any()
    assert 0.02 < float(animal.mask.double().mean()) < 0.8


def test_the_true_box_holds_the_body_tightly_along_the_trunk() -> None:
    animal = synthetic_animal(1, 3, SMALL, pose="sit")
    box = animal.cuboid_world
    assert bool(box.contains(animal.vertices).all())
    inside = box.to_box(animal.vertices).abs().amax(0)
    assert_close(inside, box.size / 2, rtol=1e-5, atol=1e-5)
    M = animal.R_world_joint[:7].mean(0)
    assert_close(
        animal.trunk.mT @ M, (animal.trunk.mT @ M).mT
    )  # the polar factor: the rest is symmetric, as for no other rotation
    assert_close(
        animal.cuboid.corners(), transform_points(rigid(animal.R, animal.t), box.corners())
    )
    assert_close(animal.faces_seen.share.sum(), torch.tensor(1.0, dtype=F64))


def test_other_vocabularies_species_and_poses_can_be_asked_for() -> None:
    animal = synthetic_animal(
        0, 0, SMALL, vocabulary=VOCABULARIES["stanfordextra24"], preset="cow", pose="graze"
    )
    assert (animal.preset, animal.pose, len(animal.keypoints_2d), len(animal.keypoint_visible)) == (
        "cow",
        "graze",
        24,
        24,
    )


def test_a_face_turned_to_the_light_is_brighter_than_one_turned_away() -> None:
    vertices = torch.tensor([[0.0, -1, -1], [0, 1, -1], [0, 0, 1]], dtype=F64)
    faces = torch.tensor([[0, 1, 2]])
    colors, K = torch.full((3, 3), 0.5, dtype=F64), intrinsics(20.0, (21, 21))
    assert_close(vertex_normals(vertices, faces)[0], torch.tensor([1.0, 0, 0], dtype=F64))
    # a camera on +x looking at it along -x; the sun has x > 0
    R = torch.tensor([[0.0, 1, 0], [0, 0, -1], [-1, 0, 0]], dtype=F64)
    t = torch.tensor([0.0, 0, 3], dtype=F64)
    front, mask = shade(vertices, faces, colors, R=R, t=t, K=K, image_hw=(21, 21))
    back, _ = shade(vertices, faces.flip(1), colors, R=R, t=t, K=K, image_hw=(21, 21))
    assert int(front[10, 10, 0]) > int(back[10, 10, 0])
    assert bool(mask[10, 10])
    assert int(front[0, 0, 0]) == round(0.86 * 255)


def test_of_two_surfaces_the_nearer_is_seen_and_an_empty_scene_is_its_background() -> None:
    square = torch.tensor([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=F64)
    faces, depth = torch.tensor([[0, 1, 2], [0, 2, 3]]), torch.tensor([0.0, 0, 1], dtype=F64)
    camera = PinholeCamera(intrinsics(10.0, (21, 21)), torch.eye(4, dtype=F64), (21, 21))
    red, green = (
        torch.tensor([[0.9, 0, 0]]).expand(4, 3).numpy(),
        torch.tensor([[0, 0.9, 0]]).expand(4, 3).numpy(),
    )
    far, near = (
        Surface(square + 4 * depth, faces, red, lambda c: c),
        Surface(0.5 * square + 3 * depth, faces, green, lambda c: c),
    )
    made = render([far, near], camera)
    assert made.owner[10, 10] == 1
    assert made.owner[10, 8] == 0
    assert made.owner[0, 0] == -1
    red_px, green_px = made.image[10, 12].tolist(), made.image[10, 10].tolist()
    assert red_px[0] > red_px[1]
    assert green_px[1] > green_px[0]
    assert made.image[0, 0].tolist() == [219, 219, 219]
    empty = render([], camera, torch.zeros(21, 21, 3).numpy(), Light(sunny=0.0))
    assert int(empty.image.max()) == 0
    assert int(empty.owner.max()) == -1


def test_the_trunk_strays_less_from_the_standing_body_than_paws_head_and_tail() -> None:
    vocabulary = VOCABULARIES["animal3d26"]
    mobility = dict(
        zip(
            vocabulary.keypoints,
            model_mobility(
                load_quadruped(), tuple(preset_betas("dog").tolist()), vocabulary
            ).tolist(),
            strict=True,
        )
    )
    assert mobility["tail_base"] < mobility["left_front_elbow"] < mobility["left_front_paw"]
    assert mobility["left_shoulder"] < mobility["neck"] < mobility["nose"]
    assert min(mobility.values()) >= BREED


def test_an_animal_that_fills_no_pixel_is_not_told_of() -> None:
    world = replace(WorldConfig(), image_hw=(16, 24), animals=(1, 1), fill=(0.02, 0.05))
    scenes = [synthetic_scene(0, index, world) for index in range(12)]
    assert all(bool(animal.mask.any()) for scene in scenes for animal in scene.animals)
    empty = [index for index, scene in enumerate(scenes) if not scene.animals]
    assert empty
    dataset = SyntheticDataset(SyntheticSet(0, 12, world))
    image, target = dataset[empty[0]]  # type: ignore[misc]
    assert image.shape == (3, 16, 24)
    assert target["corners_3d"].shape == (0, 8, 3)
    assert target["K"].shape == (3, 3)
