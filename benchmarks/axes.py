"""Angle of each axes rule to the true trunk, over all presets and poses of the quadruped.

Run: python benchmarks/axes.py
"""

import torch

from animal3dbox.geometry.rigid_transforms import rotation_angle
from animal3dbox.labels.axes.body_axes import torso_axes, trunk_axes
from animal3dbox.labels.axes.landmarks import landmark_axes
from animal3dbox.labels.axes.pca import pca_axes
from animal3dbox.smal.keypoints.vocabularies import ANIMAL3D_LANDMARKS
from animal3dbox.smal.model import trunk_rotation
from animal3dbox.smal.quadruped.poses import POSES, named_pose
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, preset_betas, quadruped_names


def main() -> None:
    """Print median, 95th percentile and maximum in degrees."""
    model = load_quadruped()
    groups = {**model.landmarks, **model.extra_landmarks}
    poses = torch.stack([named_pose(pose) for pose in POSES])
    angles: dict[str, list[float]] = {}
    for preset in quadruped_names().presets:
        body = model.posed(
            preset_betas(preset).expand(len(poses), -1),
            poses,
            torch.zeros(len(poses), 3, dtype=torch.float64),
        )
        for vertices, truth in zip(body.vertices, trunk_rotation(body.R_world_joint), strict=True):
            mesh = vertices.numpy()
            every = {name: mesh[list(ids)].mean(0) for name, ids in groups.items()}
            of_26 = {name: every[name] for name in ANIMAL3D_LANDMARKS}
            rules = {
                "torso vertices on the template": torso_axes(mesh, model),
                "pca": pca_axes(mesh),
            }
            named = {
                "trunk landmarks with hips": trunk_axes(every),
                "trunk landmarks of Animal3D's 26": trunk_axes(of_26),
            }
            named["landmarks (the paper's first rule)"] = landmark_axes(
                of_26, dict.fromkeys(of_26, True)
            )
            rules |= {name: axes[0] for name, axes in named.items() if axes is not None}
            for name, R_box in rules.items():
                angle = rotation_angle(torch.from_numpy(R_box), truth)
                angles.setdefault(name, []).append(float(torch.rad2deg(angle)))
    for name, of_rule in angles.items():
        values = torch.tensor(of_rule)
        print(
            f"{name:36} {len(of_rule)} bodies: median {values.median():6.2f}, 95 %"
            f" {values.quantile(0.95):6.2f}, most {values.amax():6.2f} degrees"
        )


if __name__ == "__main__":
    main()
