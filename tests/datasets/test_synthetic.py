import torch
from torch.testing import assert_close

from animal3dbox.datasets.bodies import BREED, model_mobility
from animal3dbox.datasets.shading import shade, vertex_normals
from animal3dbox.datasets.synthetic import noisy_keypoints, synthetic_animal
from animal3dbox.geometry.camera import intrinsics
from animal3dbox.geometry.rigid import rigid, transform_points
from animal3dbox.smal.quadruped import load_quadruped, preset_betas
from animal3dbox.smal.vocabularies import VOCABULARIES

F64 = torch.float64
SMALL = (120, 160)


def test_the_same_seed_and_index_give_the_same_animal_and_others_another() -> None:
    a, b, c = synthetic_animal(3, 1, SMALL), synthetic_animal(3, 1, SMALL), synthetic_animal(4, 1, SMALL)
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
        grown = torch.nn.functional.max_pool2d(animal.mask[None, None].double(), 5, 1, 2)[0, 0] > 0
        assert bool(grown[rows, columns].all())


def test_the_animal_stands_on_the_ground_within_the_frame_and_is_not_the_background() -> None:
    animal = synthetic_animal(1, 2, SMALL)
    assert abs(float(animal.vertices[:, 2].amin())) < 1e-12
    border = torch.cat((animal.mask[0], animal.mask[-1], animal.mask[:, 0], animal.mask[:, -1]))
    assert not border.any()
    assert 0.02 < float(animal.mask.double().mean()) < 0.8


def test_other_vocabularies_species_and_poses_can_be_asked_for() -> None:
    animal = synthetic_animal(0, 0, SMALL, VOCABULARIES["stanfordextra24"], preset="cow", pose="graze")
    assert (animal.preset, animal.pose, len(animal.keypoints_2d)) == ("cow", "graze", 24)


def test_noise_leaves_missing_keypoints_missing_and_has_its_size() -> None:
    keypoints = torch.zeros(4000, 3, dtype=F64)
    keypoints[:3000] = torch.tensor([50.0, 60, 1], dtype=F64)
    noisy = noisy_keypoints(keypoints, 2.0, torch.Generator().manual_seed(0))
    assert torch.equal(noisy[3000:], keypoints[3000:])
    assert abs(float((noisy[:3000, :2] - keypoints[:3000, :2]).std()) - 2) < 0.1
    wild = noisy_keypoints(keypoints, 0.0, torch.Generator().manual_seed(0), outliers=0.3, image_hw=(100, 200))[:3000]
    moved = (wild[:, :2] != keypoints[:3000, :2]).any(1)
    assert abs(float(moved.double().mean()) - 0.3) < 0.03
    assert bool((wild[:, 0] <= 199.5).all())
    assert bool((wild[:, 1] <= 99.5).all())


def test_a_face_turned_to_the_light_is_brighter_than_one_turned_away() -> None:
    vertices = torch.tensor([[0.0, -1, -1], [0, 1, -1], [0, 0, 1]], dtype=F64)
    faces = torch.tensor([[0, 1, 2]])
    colors, K = torch.full((3, 3), 0.5, dtype=F64), intrinsics(20.0, (21, 21))
    assert_close(vertex_normals(vertices, faces)[0], torch.tensor([1.0, 0, 0], dtype=F64))
    # a camera on +x looking at it along -x; the sun has x > 0
    R = torch.tensor([[0.0, 1, 0], [0, 0, -1], [-1, 0, 0]], dtype=F64)
    t = torch.tensor([0.0, 0, 3], dtype=F64)
    front, mask = shade(vertices, faces, colors, R, t, K, (21, 21))
    back, _ = shade(vertices, faces.flip(1), colors, R, t, K, (21, 21))
    assert int(front[10, 10, 0]) > int(back[10, 10, 0])
    assert bool(mask[10, 10])
    assert int(front[0, 0, 0]) == round(0.86 * 255)


def test_the_trunk_strays_less_from_the_standing_body_than_paws_head_and_tail() -> None:
    vocabulary = VOCABULARIES["animal3d26"]
    mobility = dict(
        zip(vocabulary.keypoints, model_mobility(load_quadruped(), tuple(preset_betas("dog").tolist()), vocabulary).tolist(), strict=True)
    )
    assert mobility["tail_base"] < mobility["left_front_elbow"] < mobility["left_front_paw"]
    assert mobility["left_shoulder"] < mobility["neck"] < mobility["nose"]
    assert min(mobility.values()) >= BREED
