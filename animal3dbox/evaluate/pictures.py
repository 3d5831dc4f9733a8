"""The paper's figures on our world: the ablation, boxes on meshes, UAV cameras round an animal."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.datasets.synthetic.faults import FaultConfig
from animal3dbox.datasets.synthetic.world.config import CLEAR
from animal3dbox.datasets.synthetic.world.render import render_scene
from animal3dbox.datasets.synthetic.world.scene import plan_scene
from animal3dbox.evaluate.config import EvaluateConfig
from animal3dbox.evaluate.plots import has_matplotlib, new_figure, png_of
from animal3dbox.evaluate.subject import Subject, subject
from animal3dbox.geometry.box_visibility import face_visibility
from animal3dbox.geometry.camera import PinholeCamera, intrinsics, look_at
from animal3dbox.geometry.cuboid import EDGES, FACE_NAMES, FACES, Cuboid
from animal3dbox.labels.axes.pca import pca_axes
from animal3dbox.labels.bounds import tight_cuboid
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.types import CuboidLabel
from animal3dbox.progress import watched
from animal3dbox.report.cuboid_pen import BACK, FRONT
from animal3dbox.report.overlay import draw_cuboid
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Picture = NDArray[np.uint8]

FAULTS = FaultConfig(noise_px=4.0, outliers=0.2)
"""Faults of the annotations that the ablation starts from."""
ROWS = {
    "basic": LabelConfig(method="basic", axes="landmarks"),
    "PCA": LabelConfig(method="paper", residual="literal", axes="pca"),
    "ours": LabelConfig(),
}
"""The ablation's rows as in the paper: the baseline's pose, principal components, everything."""
COLUMNS = 5
UAV_ELEVATION_DEG, UAV_DISTANCE, UAV_FOCAL_PX, UAV_HW = 40.0, 3.2, 560.0, (240, 320)
UAV_VIEWS = 8
ANIMAL_GREY = (0.72, 0.66, 0.58)


def pictures_of(seed: int) -> dict[str, bytes] | None:
    """The figures as caption -> PNG; None without matplotlib."""
    if not has_matplotlib():
        return None
    who = [
        subject(EvaluateConfig(animals=COLUMNS, seed=seed, world=CLEAR), index)
        for index in watched(range(COLUMNS), "drawing figures", unit="animal")
    ]
    faults = f"{FAULTS.noise_px:g} px of noise and {FAULTS.outliers:.0%} outliers"
    figures = {
        f"The same images with {faults}: basic, PCA, ours (front green and crossed,"
        " back blue, an arrow to the front)": ablation(who),
        "Boxes on the mesh, by principal components and by ours, and their projections": (
            boxes_on_meshes(who[:3])
        ),
        "UAV cameras round one animal, and the shares of its sides": uav_views(seed),
    }
    return {caption: png_of(figure) for caption, figure in figures.items()}


def ablation(who: Sequence[Subject]) -> "Figure":
    """Rows basic, PCA and ours on the same images."""
    figure, panels = new_figure(2.6 * len(who), 2.1 * len(ROWS), len(ROWS), len(who))
    for row, (name, config) in enumerate(ROWS.items()):
        for column, one in enumerate(who):
            panel, label = panels[row * len(who) + column], one.annotated(FAULTS).labelled(config)
            picture = one.animal.image.numpy().copy()
            if isinstance(label, CuboidLabel):
                draw_cuboid(picture, label.cuboid, label.K)
            else:
                panel.set_xlabel(label.reason, fontsize=8)
            _show(panel, picture)
            if column == 0:
                panel.set_ylabel(name, fontsize=12)
            if row == 0:
                panel.set_title(one.animal.sample_id, fontsize=8)
    return figure


def boxes_on_meshes(who: Sequence[Subject]) -> "Figure":
    """A row an animal: PCA's box and ours on the mesh in 3D, then both in the image."""
    figure, panels = new_figure(11, 2.4 * len(who), len(who), 4)
    for row, one in enumerate(who):
        animal = one.animal
        label = one.annotated(FaultConfig()).labelled(LabelConfig())
        ours = (
            animal.cuboid_world
            if not isinstance(label, CuboidLabel)
            else tight_cuboid(animal.vertices, animal.R.mT @ label.cuboid_mesh.rotation)
        )
        by_name = {
            "principal components": tight_cuboid(animal.vertices, pca_axes(animal.vertices)),
            "ours": ours,
        }
        for column, (name, box) in enumerate(by_name.items()):
            flat, spatial = panels[4 * row + 2 + column], _as_3d(figure, panels[4 * row + column])
            _draw_mesh(spatial, animal.vertices, box)
            picture = animal.image.numpy().copy()
            draw_cuboid(picture, box.transformed(animal.camera.T_cam_world), animal.K)
            _show(flat, picture)
            if row == 0:
                spatial.set_title(f"{name}, on the mesh", fontsize=9)
                flat.set_title(f"{name}, in the image", fontsize=9)
    return figure


def uav_views(seed: int) -> "Figure":
    """One zebra under cameras on a circle round it.

    Where they are, and what each sees with the shares of the sides.
    """
    plan = plan_scene(seed, 0, replace(CLEAR, presets=("zebra",), poses=("walk",)))
    vertices = plan.animals[0].vertices
    middle = (vertices.amax(0) + vertices.amin(0)) / 2
    cameras = [_uav_camera(middle, number) for number in range(UAV_VIEWS)]
    box = subject(
        EvaluateConfig(
            animals=1, seed=seed, world=replace(CLEAR, presets=("zebra",), poses=("walk",))
        ),
        0,
    ).animal.cuboid_world
    figure, panels = new_figure(12, 6.6, 3, 4)
    stage = _as_3d(figure, panels[0])
    _draw_mesh(stage, vertices, box, around=[camera.center_world for camera in cameras])
    stage.set_title("where the cameras are", fontsize=9)
    for number, camera in enumerate(cameras):
        panel = panels[4 + number]
        picture = (
            render_scene(replace(plan, camera=camera, things=(), ground_z=0.0)).image.numpy().copy()
        )
        seen_box = box.transformed(camera.T_cam_world)
        draw_cuboid(picture, seen_box, camera.K)
        _show(panel, picture)
        panel.set_title(f"{number + 1}", fontsize=9, loc="left")
        panel.set_xlabel(_shares(seen_box, camera), fontsize=8)
    _draw_shares(
        panels[1:4],
        [face_visibility(box.transformed(c.T_cam_world), c.K, c.image_hw).share for c in cameras],
    )
    return figure


def _draw_shares(panels: Sequence[Any], shares: Sequence[Tensor]) -> None:
    """Bars of the shares over the first of the panels' room; the others are taken away."""
    bars, *others = panels
    spec = bars.get_subplotspec().get_gridspec()
    bars.set_subplotspec(spec[0, 1:4])
    for other in others:
        other.remove()
    below = np.zeros(len(shares))
    for face, name in enumerate(FACE_NAMES[:5]):
        part = np.array([float(share[face]) for share in shares])
        bars.bar(range(1, len(shares) + 1), 100 * part, bottom=below, label=name, width=0.7)
        below += 100 * part
    bars.set(
        ylabel="share of the visible area, %",
        xticks=range(1, len(shares) + 1),
        xlim=(0.4, len(shares) + 1.9),
    )
    bars.set_title("shares by camera", fontsize=9)
    bars.legend(fontsize=8, loc="center right")


def _uav_camera(middle: Tensor, number: int) -> PinholeCamera:
    turn, rise = 2 * math.pi * number / UAV_VIEWS, math.radians(UAV_ELEVATION_DEG)
    away = torch.tensor(
        [math.cos(rise) * math.cos(turn), math.cos(rise) * math.sin(turn), math.sin(rise)],
        dtype=torch.float64,
    )
    up = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    return PinholeCamera(
        intrinsics(UAV_FOCAL_PX, UAV_HW), look_at(middle + UAV_DISTANCE * away, middle, up), UAV_HW
    )


def _shares(box: Cuboid, camera: PinholeCamera) -> str:
    share = face_visibility(box, camera.K, camera.image_hw).share.tolist()
    return "  ".join(
        f"{name} {100 * part:.0f} %"
        for part, name in sorted(zip(share, FACE_NAMES, strict=True), reverse=True)
        if part > 0
    )


def _as_3d(figure: "Figure", panel: Any) -> Any:
    """The panel's place as axes in 3D."""
    spec = panel.get_subplotspec()
    panel.remove()
    return figure.add_subplot(spec, projection="3d")


def _draw_mesh(axes: Any, vertices: Tensor, box: Cuboid, around: Sequence[Tensor] = ()) -> None:
    """A shaded mesh, its box, front green and crossed, back blue, and numbered points around."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    corners = vertices[load_quadruped().faces].numpy()
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    light = 0.55 + 0.45 * (normals @ np.array([0.3, -0.5, 0.81])).clip(0)
    axes.add_collection3d(
        Poly3DCollection(corners, facecolors=light[:, None] * np.array(ANIMAL_GREY), linewidths=0)
    )
    points = box.corners().numpy()
    for name, color in (("front", FRONT), ("back", BACK)):
        axes.add_collection3d(
            Poly3DCollection(
                [points[list(FACES[name])]],
                facecolors=[(*(np.array(color) / 255), 0.35)],
                linewidths=0,
            )
        )
    for a, b in EDGES:
        axes.plot(*points[[a, b]].T, color="tab:orange", linewidth=1)
    first, second, third, fourth = FACES["front"]
    for a, b in ((first, third), (second, fourth)):
        axes.plot(*points[[a, b]].T, color=np.array(FRONT) / 255, linewidth=1)
    for number, place in enumerate(around):
        axes.scatter(*place.tolist(), color="tab:red", s=14)
        axes.text(*place.tolist(), f" {number + 1}", fontsize=8)
    every = np.concatenate([points, *(place.numpy()[None] for place in around)])
    low, high = every.min(0), every.max(0)
    middle, half = (low + high) / 2, (high - low).max() / 2
    axes.set(
        xlim=middle[0] + [-half, half],
        ylim=middle[1] + [-half, half],
        zlim=middle[2] + [-half, half],
    )
    axes.set_box_aspect((1, 1, 1), zoom=1.5)
    axes.view_init(elev=22, azim=-58)
    axes.set_axis_off()


def _show(panel: Any, picture: Picture) -> None:
    panel.imshow(picture)
    panel.set(xticks=[], yticks=[])
