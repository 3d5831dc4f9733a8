"""A stand-in for a user's SMAL model: our quadruped with another rest pose and shape basis.

Nothing of SMAL's is in it. Its template stands with its legs apart, bent, its head low and its tail
up; its betas are standard normal numbers that are mixed, as SMAL's are, of the quadruped's shapes.
It is written as a SMAL pickle and read back by the package's converter.
"""

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch
from numpy.typing import NDArray

from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.labels.fit.shape_prior import _quadruped_shapes, _square_root
from animal3dbox.smal.files.model_files import load_model
from animal3dbox.smal.files.pickle_writer import write_smal_pickle
from animal3dbox.smal.files.safetensors_file import save_safetensors
from animal3dbox.smal.model import SmalModel
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped

Array = NDArray[np.float64]
REST_DEG = {
    "LLeg1": (14.0, 25.0, 0.0),
    "LLeg2": (0.0, -30.0, 0.0),
    "LLeg3": (0.0, 20.0, 0.0),
    "LLegBack1": (12.0, -20.0, 0.0),
    "LLegBack2": (0.0, 30.0, 0.0),
    "LLegBack3": (0.0, -35.0, 0.0),
    "Neck": (0.0, 35.0, 0.0),
    "Head": (0.0, -20.0, 0.0),
    "Tail1": (0.0, 40.0, 0.0),
    "Tail2": (0.0, 20.0, 0.0),
}
"""The stand-in's rest pose in the quadruped's angles, of the left side; the right is its mirror."""
LANDMARKS = {**load_quadruped().landmarks, **load_quadruped().extra_landmarks}


def rest_pose() -> Array:
    """The rest pose (J, 3) in the quadruped's angles, radians."""
    names = load_quadruped().joint_names
    pose = np.zeros((len(names), 3))
    for name, (x, y, z) in REST_DEG.items():
        pose[names.index(name)] = x, y, z
        if name.startswith("L"):
            pose[names.index("R" + name[1:])] = -x, y, -z
    return np.deg2rad(pose)


def posed(betas: Array, pose: Array) -> Array:
    """The quadruped's vertices and joints (B, V + J, 3), without pose correctives."""
    model = load_quadruped()
    body = model.posed(
        torch.from_numpy(betas),
        torch.from_numpy(np.tile(pose, (len(betas), 1, 1))),
        torch.zeros(len(betas), 3, dtype=torch.float64),
    )
    return np.concatenate((as_numpy(body.vertices), as_numpy(body.joints)), axis=1)


def stand_in() -> SmalModel:
    """The model, made in memory."""
    model = load_quadruped()
    mean, covariance = _quadruped_shapes(None)
    mixed = np.linalg.qr(np.random.default_rng(4).standard_normal(covariance.shape))[0]
    basis = _square_root(covariance) @ mixed
    base = posed(mean[None], rest_pose())[0]
    columns = posed(mean + basis.T, rest_pose()) - base  # skinning is linear in the shape
    count = model.vertex_count
    # Joints of every shape, by the vertices' least weights
    known = np.concatenate((base[None], columns)).transpose(1, 0, 2).reshape(len(base), -1)
    known = np.concatenate((known, np.ones((len(base), 1))), axis=1)
    regressor = np.linalg.lstsq(known[:count].T, known[count:].T, rcond=None)[0].T
    return SmalModel(
        v_template=torch.from_numpy(base[:count].copy()),
        faces=model.faces,
        shapedirs=torch.from_numpy(columns[:, :count].transpose(1, 2, 0).copy()),
        posedirs=torch.zeros_like(model.posedirs),
        J_regressor=torch.from_numpy(regressor),
        weights=model.weights,
        parents=model.parents,
        joint_names=model.joint_names,
        landmarks=LANDMARKS,
    )


@cache
def converted_stand_in() -> SmalModel:
    """The model as a SMAL pickle that went through the converter."""
    with TemporaryDirectory() as folder:
        pickle, converted = Path(folder, "smal.pkl"), Path(folder, "smal.safetensors")
        write_smal_pickle(stand_in(), pickle)
        save_safetensors(load_model(pickle, LANDMARKS), converted)
        return load_model(converted)
