"""What is seen against exact rays that share no code with the package."""

import numpy as np
import torch
from animals import IMAGE_HW, K, camera_round
from numpy.typing import NDArray
from torch.testing import assert_close

from animal3dbox.datasets.synthetic.scenes import exact_keypoints
from animal3dbox.geometry.rasterizer import silhouette
from animal3dbox.geometry.visible_surface import surface_share, visible_vertices
from animal3dbox.labels.label import label_animal
from animal3dbox.labels.types import CuboidLabel
from animal3dbox.labels.visibility.superimposed_mask import superimposed_mask
from animal3dbox.labels.visibility.visible_keypoints import visible_keypoints
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES
from animal3dbox.smal.quadruped.poses import POSES, named_pose
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, preset_betas, quadruped_names

F64 = torch.float64
EYE = torch.eye(3, dtype=F64)
Array = NDArray[np.float64]


def free_line_of_sight(
    vertices: Array, faces: NDArray[np.int64], ids: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Whether no triangle but its own lies on the segment from the origin to each vertex (Moeller
    and Trumbore), one by one."""
    a, edge_1, edge_2 = (
        vertices[faces[:, 0]],
        vertices[faces[:, 1]] - vertices[faces[:, 0]],
        vertices[faces[:, 2]] - vertices[faces[:, 0]],
    )
    free = []
    for i in ids:
        direction = vertices[i]
        p = np.cross(direction, edge_2)
        det = (edge_1 * p).sum(1)
        with np.errstate(divide="ignore", invalid="ignore"):
            u = -(a * p).sum(1) / det
            q = np.cross(-a, edge_1)
            v = (q @ direction) / det
            t = (edge_2 * q).sum(1) / det
        blocks = (
            (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0) & (t < 1 - 1e-6) & ~(faces == i).any(1)
        )
        free.append(not blocks.any())
    return np.array(free)


def test_visible_vertices_are_those_with_a_free_line_of_sight_in_200_posed_views() -> None:
    model, names = load_quadruped(), list(POSES)
    faces, generator = model.faces.numpy(), np.random.default_rng(0)
    right = total = 0
    for view in range(200):
        preset = quadruped_names().presets[view % len(quadruped_names().presets)]
        pose = named_pose(names[view % len(names)])[None]
        vertices = model.posed(
            preset_betas(preset)[None], pose, torch.zeros(1, 3, dtype=F64)
        ).vertices[0]
        R, t = camera_round(
            float(generator.uniform(0, 360)),
            float(generator.uniform(-10, 85)),
            distance=float(generator.uniform(1.8, 6)),
        )
        cam = vertices @ R.mT + t
        ids = generator.choice(len(cam), 25, replace=False)
        px = (cam @ K.mT)[:, :2] / cam[:, 2:]
        inside = (
            (px > -0.5).all(1) & (px[:, 0] < IMAGE_HW[1] - 0.5) & (px[:, 1] < IMAGE_HW[0] - 0.5)
        ).numpy()[ids]
        expected = free_line_of_sight(cam.numpy(), faces, ids) & inside
        right += int(
            (
                visible_vertices(cam, model.faces, K, IMAGE_HW, ids=torch.from_numpy(ids)).numpy()
                == expected
            ).sum()
        )
        total += len(ids)
    assert right / total >= 0.995


def test_of_two_plates_only_the_nearer_is_seen_and_outside_the_frame_nothing() -> None:
    plate = torch.tensor([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=F64)
    vertices = torch.cat(
        (
            plate + torch.tensor([0.0, 0, 4]),
            0.5 * plate + torch.tensor([0.0, 0, 5]),
            plate + torch.tensor([90.0, 0, 5]),
        )
    )
    faces = torch.cat([torch.tensor([[0, 1, 2], [0, 2, 3]]) + 4 * k for k in range(3)])
    assert visible_vertices(vertices, faces, K, IMAGE_HW).tolist() == [True] * 4 + [False] * 8
    assert visible_vertices(vertices, faces, K, IMAGE_HW, ids=torch.tensor([5, 0])).tolist() == [
        False,
        True,
    ]
    assert not visible_vertices(vertices - torch.tensor([0.0, 0, 50]), faces, K, IMAGE_HW).any()


def test_a_body_that_reaches_behind_the_camera_hides_what_is_behind_its_near_part() -> None:
    floor = torch.tensor(
        [[-5.0, 0.5, -3], [5, 0.5, -3], [0, 0.5, 30], [0, 2, 8], [0.1, 2.1, 8], [0, 2.1, 8]],
        dtype=F64,
    )
    faces = torch.tensor([[0, 1, 2], [3, 4, 5]])
    assert visible_vertices(floor, faces, K, IMAGE_HW).tolist() == [
        False,
        False,
        True,
        False,
        False,
        False,
    ]


def test_from_its_left_an_animal_shows_its_left_keypoints_and_its_left_surface() -> None:
    model, vocabulary = load_quadruped(), VOCABULARIES["animal3d26"]
    R, t = camera_round(90, 0, distance=4)
    cam = model.v_template @ R.mT + t
    seen = dict(
        zip(
            vocabulary.keypoints,
            visible_keypoints(
                vocabulary, model.landmark_groups, cam, model.faces, K=K, image_hw=IMAGE_HW
            ).tolist(),
            strict=True,
        )
    )
    assert all(
        seen[name]
        for name in ("left_eye", "left_shoulder", "left_front_paw", "left_back_knee", "left_ear")
    )
    assert not any(seen[name] for name in ("right_eye", "right_shoulder", "right_mouth"))
    share = surface_share(cam, model.faces, R, K=K, image_hw=IMAGE_HW)
    assert int(share.argmax()) == 2
    assert abs(float(share.sum()) - 1) < 1e-12
    assert float(share[3]) < 0.05


def test_the_surface_shares_of_a_cube_are_those_of_its_faces() -> None:
    corners = torch.tensor(
        [[x, y, z] for x in (-1.0, 1) for y in (-1.0, 1) for z in (-1.0, 1)], dtype=F64
    )
    quads = torch.tensor(
        [[4, 6, 7, 5], [0, 1, 3, 2], [2, 3, 7, 6], [0, 4, 5, 1], [1, 5, 7, 3], [0, 2, 6, 4]]
    )
    faces = torch.cat((quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]))
    R, t = camera_round(40, 25, distance=7)
    label = label_animal(
        IMAGE_HW,
        vertices=corners,
        faces=faces,
        keypoints_3d=None,
        K=K,
        pose=(R, t),
        template=None,
        config=None,
    )
    assert not isinstance(label, CuboidLabel)  # a bare cube does not say where its nose is
    share = surface_share(corners @ R.mT + t, faces, R, K=K, image_hw=IMAGE_HW)
    ray = -(
        R.mT @ t
    )  # the camera, seen from the cube: areas go with the cosines, perspective aside
    expected = torch.tensor([ray[0], 0, ray[1], 0, ray[2], 0]).clamp_min(0)
    assert_close(share, expected / expected.sum(), atol=0.06, rtol=0)
    assert share[[1, 3, 5]].tolist() == [0, 0, 0]


def test_a_label_tells_the_side_of_the_surface_beside_that_of_the_box() -> None:
    model = load_quadruped()
    R, t = camera_round(-80, 10, distance=4)
    label = label_animal(
        IMAGE_HW, vertices=model.v_template, faces=model.faces, template=model, K=K, pose=(R, t)
    )
    assert isinstance(label, CuboidLabel)
    assert label.surface_share is not None
    assert label.surface_side == label.side == "right"
    assert_close(
        label.surface_share,
        surface_share(
            model.v_template @ R.mT + t, model.faces, label.rotation, K=K, image_hw=IMAGE_HW
        ),
    )
    bare = label_animal(IMAGE_HW, vertices=model.v_template, template=model, K=K, pose=(R, t))
    assert isinstance(bare, CuboidLabel)
    assert bare.surface_side is None


def test_the_superimposed_mask_is_the_silhouette_under_the_given_camera() -> None:
    model = load_quadruped()
    R, t = camera_round(30, 10, distance=4)
    mask = superimposed_mask(model.v_template, model.faces, K=K, pose=(R, t), image_hw=IMAGE_HW)
    assert torch.equal(mask, silhouette(model.v_template @ R.mT + t, model.faces, K, IMAGE_HW))
    keypoints = exact_keypoints(
        VOCABULARIES["animal3d26"].on_body(model.landmark_groups, model.v_template),
        K,
        R,
        t,
        image_hw=IMAGE_HW,
    )
    assert (
        int(mask[keypoints[:, 1].round().long(), keypoints[:, 0].round().long()].sum()) >= 25
    )  # one may lie on the very outline
