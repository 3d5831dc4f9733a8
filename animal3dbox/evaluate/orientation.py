"""Stability of body axes under noise, by named protocols (section 3.1, theta_R and delta_a)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from animal3dbox.datasets.synthetic.faults import FaultConfig
from animal3dbox.evaluate.subject import Annotated, Subject
from animal3dbox.evaluate.tables import PAPER, Cell, Table, mean, table_from_records
from animal3dbox.geometry.orthogonal_frames import frame_from_directions
from animal3dbox.geometry.rigid_transforms import alignment_variation, rotation_angle
from animal3dbox.labels.axes.body_axes import body_axes
from animal3dbox.labels.body import Body
from animal3dbox.labels.config import Axes, LabelConfig
from animal3dbox.labels.observation import observe
from animal3dbox.labels.types import CuboidLabel

_LENGTHS = (
    0.7,
    0.3,
)  # of the landmarks' directions, before they are made unit long: about a trunk's and a chest's
SIGMAS = (0.5, 1.0, 2.0, 3.0, 4.0)
RULES: dict[str, tuple[Axes, bool]] = {
    "landmarks (paper)": ("landmarks", False),
    "pca of landmarks": ("pca", False),
    "pca of mesh": ("pca", True),
    "ours, landmarks": ("default", False),
    "ours, mesh": ("default", True),
}
"""Rule -> LabelConfig.axes, and whether it sees the mesh (with its template) or the landmarks
alone."""
PROTOCOLS = {
    "image": "noise of sigma px on the image keypoints; axes in the body's own frame",
    "pixel-equivalent": (
        "noise on landmarks and vertices in 3D of the size that is sigma px at the animal's depth"
    ),
    "camera": (
        "noise of sigma px on the image keypoints; axes in the camera frame, through the default"
        " camera pose"
    ),
    "model units": (
        "noise of sigma model units (the animal is about one long) on landmarks and vertices in 3D"
    ),
}
PUBLISHED: tuple[dict[str, Cell], ...] = tuple(
    {
        "protocol": f"({PAPER})",
        "rule": rule,
        "theta_R deg": theta_deg,
        "delta_a ideal": delta,
    }
    for rule, theta_deg, delta in (("pca", 120.68, 0.5034), ("theirs", 0.0046, 0.0))
)


@dataclass(frozen=True)
class StabilityRow:
    """One animal under one noise by one rule.

    Axes in the order anterior-posterior, left-right, dorsal-ventral.

    Attributes:
        index: of the animal.
        protocol: of PROTOCOLS.
        rule: of RULES.
        sigma: of SIGMAS.
        theta_deg: rotation from the rule's own axes without noise.
        theta_float32_deg: the same angle by the paper's formula in float32, arccos of a trace.
        delta_own: 1 - cos of each axis from the rule's own axis without noise.
        delta_ideal: 1 - cos of each axis from the paper's ideal one, of the landmarks without
            noise.

    Example:
        >>> row = StabilityRow(
        ...     index=0,
        ...     protocol="image",
        ...     rule="ours, mesh",
        ...     sigma=2.0,
        ...     theta_deg=0.0,
        ...     theta_float32_deg=0.02,
        ...     delta_own=(0.0, 0.0, 0.0),
        ...     delta_ideal=(0.1, 0.0, 0.1),
        ... )
        >>> row.theta_deg  # axes of the mesh do not see the noise of an image
        0.0
    """

    index: int
    protocol: str
    rule: str
    sigma: float
    theta_deg: float
    theta_float32_deg: float
    delta_own: tuple[float, float, float]
    delta_ideal: tuple[float, float, float]


def axes_of(
    annotated: Annotated, rule: str, *, keypoints: Tensor, landmarks: Tensor, vertices: Tensor
) -> Tensor | None:
    """R_box (3, 3) by a rule of RULES, from keypoints (J, 3), landmarks (J, 3) and vertices (V, 3).

    None if it has none.
    """
    axes, with_mesh = RULES[rule]
    annotation = annotated.annotation
    mesh, template = (vertices, annotated.animal.model) if with_mesh else (None, None)
    observation = observe(
        image_hw=annotation.image_hw,
        body=Body(mesh, None, landmarks, None, template),
        keypoints_2d=keypoints,
        K=annotation.K,
        vocabulary=annotation.vocabulary,
        sample_id=annotation.sample_id,
        config=LabelConfig(),
    )
    axes_and_rule = body_axes([observation], axes)[0]
    return None if axes_and_rule is None else torch.from_numpy(axes_and_rule[0])


def float32_angle_deg(R_a: Tensor, R_b: Tensor) -> float:
    """The angle between two frames (3, 3) by arccos of a trace, the frames too built in float32.

    The paper's formula as it is often run.
    """
    frames = [
        frame_from_directions(
            (_LENGTHS[0] * R[:, 0].float()).numpy(), (_LENGTHS[1] * R[:, 1].float()).numpy()
        )
        for R in (R_a, R_b)
    ]
    difference = torch.stack(
        [torch.eye(3) if frame is None else torch.from_numpy(frame) for frame in frames]
    )
    trace = (difference[0] @ difference[1].mT).trace()
    return float(torch.rad2deg(torch.arccos(((trace - 1) / 2).clamp(-1, 1))))


def stability_rows(subject: Subject) -> list[StabilityRow]:
    """One animal under every protocol and noise, by every rule."""
    annotated = subject.annotated(FaultConfig())
    still = {
        "keypoints": annotated.annotation.keypoints_2d,
        "landmarks": annotated.landmarks,
        "vertices": annotated.vertices,
    }
    axes_still = {rule: axes_of(annotated, rule, **still) for rule in RULES}
    ideal = axes_still["landmarks (paper)"]
    label_still = annotated.labelled(LabelConfig())
    units_per_px = float(annotated.vertices[:, 2].mean() / annotated.annotation.K[0, 0])
    rows = []
    for sigma in SIGMAS:
        keypoints, noise_3d = _noise(subject, still, sigma)
        annotation = replace(annotated.annotation, keypoints_2d=keypoints)
        label = replace(annotated, annotation=annotation).labelled(LabelConfig())
        for rule in RULES:
            blank = StabilityRow(subject.index, "", rule, sigma, 0.0, 0.0, (0.0,) * 3, (0.0,) * 3)
            before = axes_still[rule]
            after = axes_of(annotated, rule, **{**still, "keypoints": keypoints})
            rows += _compared(replace(blank, protocol="image"), before, after, ideal)
            for protocol, size in (
                ("pixel-equivalent", units_per_px * sigma),
                ("model units", sigma),
            ):
                shifted = {name: still[name] + size * noise for name, noise in noise_3d.items()}
                after_3d = axes_of(annotated, rule, **{**still, **shifted})
                rows += _compared(replace(blank, protocol=protocol), before, after_3d, ideal)
            if isinstance(label_still, CuboidLabel) and isinstance(label, CuboidLabel):
                in_camera = [
                    None if axes is None else pose.R @ axes
                    for pose, axes in ((label_still, before), (label, after), (label_still, ideal))
                ]
                rows += _compared(replace(blank, protocol="camera"), *in_camera)
    return rows


def _noise(
    subject: Subject, still: dict[str, Tensor], sigma: float
) -> tuple[Tensor, dict[str, Tensor]]:
    """Keypoints (J, 3) with noise of sigma px, and unit noise for landmarks and vertices."""
    keypoints = still["keypoints"]
    noise_px = sigma * subject.normal(f"image-{sigma}", (len(keypoints), 2))
    moved_px = keypoints[:, :2] + noise_px * (keypoints[:, 2:] > 0)
    noise_3d = {
        name: subject.normal(f"{name}-{sigma}", tuple(still[name].shape))
        for name in ("landmarks", "vertices")
    }
    return torch.cat((moved_px, keypoints[:, 2:]), dim=1), noise_3d


def _compared(
    blank: StabilityRow, before: Tensor | None, after: Tensor | None, ideal: Tensor | None
) -> list[StabilityRow]:
    """The row of two sets of axes (3, 3), a blank one filled in; none if a set is missing."""
    if before is None or after is None or ideal is None:
        return []
    delta_own, delta_ideal = (
        tuple(alignment_variation(reference.mT, after.mT).tolist()) for reference in (before, ideal)
    )
    return [
        replace(
            blank,
            theta_deg=float(torch.rad2deg(rotation_angle(after, before))),
            theta_float32_deg=float32_angle_deg(after, before),
            delta_own=delta_own,
            delta_ideal=delta_ideal,
        )
    ]


def stability_table(rows: Sequence[StabilityRow]) -> Table:
    """Every protocol and rule, beside the paper's figures."""
    records = [_statistics(protocol, rule, rows) for protocol in PROTOCOLS for rule in RULES]
    animals = len({row.index for row in rows})
    notes = (
        "theta_R: mean angle to the rule's own axes without noise, per sigma and over all, of"
        f" {animals} animals. delta: 1 - cos per axis, anterior-posterior, left-right,"
        " dorsal-ventral, and their mean; ideal: against the landmark axes without noise, as the"
        " paper defines it.",
        "theta_R float32: the same with axes built in float32 and by arccos of a trace: thousandths"
        " of a degree for no rotation at all.",
        *(f"{name}: {meaning}." for name, meaning in PROTOCOLS.items()),
        f"{PAPER}: published figures, not computed here.",
    )
    title = "Orientation stability under noise"
    return table_from_records("stability", title, [*records, *PUBLISHED], notes=notes)


def _statistics(protocol: str, rule: str, rows: Sequence[StabilityRow]) -> dict[str, Cell]:
    """The row of the table for one protocol and one rule."""
    selected = [row for row in rows if (row.protocol, row.rule) == (protocol, rule)]
    by_sigma = {
        f"sigma {sigma:g}": mean(row.theta_deg for row in selected if row.sigma == sigma)
        for sigma in SIGMAS
    }
    return {
        "protocol": protocol,
        "rule": rule,
        **by_sigma,
        "theta_R deg": mean(row.theta_deg for row in selected),
        "delta AP": mean(row.delta_own[0] for row in selected),
        "delta LR": mean(row.delta_own[1] for row in selected),
        "delta DV": mean(row.delta_own[2] for row in selected),
        "delta_a": mean(delta for row in selected for delta in row.delta_own),
        "ideal AP": mean(row.delta_ideal[0] for row in selected),
        "delta_a ideal": mean(delta for row in selected for delta in row.delta_ideal),
        "theta_R float32": mean(row.theta_float32_deg for row in selected),
    }
