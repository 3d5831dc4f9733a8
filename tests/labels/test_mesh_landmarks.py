"""A mesh in SMAL's order needs neither landmarks nor a model."""

import numpy as np
import torch
from animals import IMAGE_HW, K, camera_round
from smal_like import smal_like_mesh

from animal3dbox import CuboidLabel, Rejection, label_animal
from animal3dbox.labels.mesh_landmarks import SMAL_NOTE
from animal3dbox.smal.keypoints.smal_topology import SMAL_LANDMARKS
from animal3dbox.smal.keypoints.vocabularies import ANIMAL3D_26

VIEW = camera_round(60, 12)


def test_landmarks_are_read_off_smals_ids_and_the_label_says_so() -> None:
    vertices, faces = smal_like_mesh()
    own_names = [name.replace("shoulder", "shoulder_blade") for name in ANIMAL3D_26]
    places = [vertices[list(SMAL_LANDMARKS[name])].mean(0) for name in own_names]
    found = label_animal(IMAGE_HW, vertices=vertices, faces=faces, K=K, pose=VIEW)
    given = label_animal(
        IMAGE_HW, keypoints_3d=torch.stack(places), vertices=vertices, faces=faces, K=K, pose=VIEW
    )
    assert isinstance(found, CuboidLabel)
    assert isinstance(given, CuboidLabel)
    np.testing.assert_allclose(found.row, given.row, atol=1e-9)
    assert SMAL_NOTE in found.quality.warnings
    assert SMAL_NOTE not in given.quality.warnings


def test_as_many_vertices_in_another_order_have_no_landmarks() -> None:
    vertices, _ = smal_like_mesh()
    order = torch.randperm(3889, generator=torch.Generator().manual_seed(1))
    outcome = label_animal(IMAGE_HW, vertices=vertices[order], K=K, pose=VIEW)
    assert isinstance(outcome, Rejection)
    assert outcome.reason == "no_axes"
