"""Faults of annotations as dials: each mistake of annotators, fitters and programs by a number.

Every fault draws from random numbers of its own, so that turning one dial leaves the others' draws
as they are, and a larger number makes more of the same fault.
"""

import zlib
from dataclasses import dataclass, fields, replace
from typing import Literal

import cv2
import numpy as np
import torch
from torch import Tensor

from animal3dbox.datasets.synthetic.annotation import Annotation, root_joint
from animal3dbox.errors import ConfigError
from animal3dbox.smal.keypoints.exchanges import PARTS, exchange_order
from animal3dbox.smal.keypoints.vocabulary import Vocabulary
from animal3dbox.smal.model import SmalModel
from animal3dbox.smal.parameters import SmalParameters
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, quadruped_names

Swap = Literal["none", "all", "legs", "fore", "hind", "head"]
"""Parts of the body whose left and right keypoints may be exchanged."""


@dataclass(frozen=True)
class FaultConfig:
    """The faults of a synthetic dataset's annotations; the defaults make none.

    Attributes:
        noise_px: standard deviation of every marked keypoint, along u and along v.
        noise_extent: the same beside it, as a part of the longer side of the marked keypoints' box;
            photographs' annotators are at 0.012 to 0.02.
        outliers: part of the marked keypoints that lie anywhere in the image instead.
        missing: part of the marked keypoints that are not marked.
        zeros: part of the marked keypoints that stay at (0, 0) and are still marked. label_animal
            takes such for missing; the fault reproduces the harm of not doing so.
        wrong_flags: part of the keypoints in the frame whose mark is the opposite of what it should
            be.
        swap: part of the body whose left and right keypoints are exchanged.
        swapped: part of the animals to which that happens.
        focal_factor: the annotated focal length by the true one; the body's depth follows it.
        joint_deg: standard deviation of the misfit of each joint's axis-angle entries but the
            root's.
        body_scale: size of the fitted body by the true one.
        mask_px: pixels by which the mask is grown, or shrunk if negative.

    Example:
        >>> FaultConfig().at_rest, FaultConfig(noise_px=2.0).at_rest
        (True, False)

    """

    noise_px: float = 0.0
    noise_extent: float = 0.0
    outliers: float = 0.0
    missing: float = 0.0
    zeros: float = 0.0
    wrong_flags: float = 0.0
    swap: Swap = "none"
    swapped: float = 1.0
    focal_factor: float = 1.0
    joint_deg: float = 0.0
    body_scale: float = 1.0
    mask_px: int = 0

    def __post_init__(self) -> None:
        for field in ("outliers", "missing", "zeros", "wrong_flags", "swapped"):
            if not 0 <= getattr(self, field) <= 1:
                raise ConfigError(f"{field} must be a part from 0 to 1, got {getattr(self, field)}")
        for field, low, high in (
            ("noise_px", 0, 1e6),
            ("noise_extent", 0, 1),
            ("joint_deg", 0, 180),
            ("focal_factor", 0.01, 100),
            ("body_scale", 0.1, 10),
        ):
            if not low <= getattr(self, field) <= high:
                raise ConfigError(
                    f"{field} must be from {low:g} to {high:g}, got {getattr(self, field)}"
                )
        if self.swap not in ("none", *PARTS):
            raise ConfigError(f"swap must be one of none, {', '.join(PARTS)}, got {self.swap!r}")

    @property
    def at_rest(self) -> bool:
        """Whether these dials leave an annotation as it is."""
        idle = ("swapped",) if self.swap == "none" else ()
        return all(getattr(self, f.name) == f.default for f in fields(self) if f.name not in idle)


def faulty(annotation: Annotation, faults: FaultConfig, seed: int = 0) -> Annotation:
    """The annotation with faults; the same for the same sample, faults and seed.

    Args:
        annotation: the faultless one, which stays as it is.
        faults: the dials. Keypoints are swapped, then moved, then thrown, then lost; flags are
            last.
        seed: another seed makes the same faults elsewhere.

    """
    name, vocabulary = annotation.sample_id, annotation.vocabulary
    keypoints = swapped_keypoints(
        name, vocabulary, annotation.keypoints_2d, faults=faults, seed=seed
    )
    focal_factors = [faults.focal_factor, faults.focal_factor, 1.0]
    return replace(
        annotation,
        keypoints_2d=faulty_keypoints(
            name, annotation.image_hw, keypoints, faults=faults, seed=seed
        ),
        mask=resized_mask(annotation.mask, faults.mask_px),
        K=annotation.K @ torch.diag(torch.tensor(focal_factors, dtype=torch.float64)),
        parameters=_misfit(annotation, faults, seed),
    )


def swap_order(vocabulary: Vocabulary, part: Swap) -> list[int]:
    """The keypoints (J,) that take each keypoint's place when a part's left and right change."""
    if part == "none":
        return list(range(len(vocabulary)))
    return list(exchange_order(vocabulary, part))


def resized_mask(mask: Tensor, px: int) -> Tensor:
    """A mask (H, W) bool grown by a disc of so many pixels, or shrunk by a negative number.

    The frame's border does not shrink it, and it is never empty unless it was before.
    """
    if px == 0:
        return mask
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * abs(px) + 1, 2 * abs(px) + 1))
    change = cv2.dilate if px > 0 else cv2.erode
    changed = torch.from_numpy(change(mask.numpy().astype(np.uint8), disc).astype(bool))
    return changed if bool(changed.any()) else mask


def swapped_keypoints(
    sample_id: str, vocabulary: Vocabulary, keypoints: Tensor, *, faults: FaultConfig, seed: int
) -> Tensor:
    """The keypoints (J, 3), their left and right exchanged if the sample is one of those."""
    if faults.swap == "none" or not _draw(sample_id, seed, "swap", 1)[0] < faults.swapped:
        return keypoints
    return keypoints[torch.tensor(swap_order(vocabulary, faults.swap))]


def faulty_keypoints(
    sample_id: str, image_hw: tuple[int, int], keypoints: Tensor, *, faults: FaultConfig, seed: int
) -> Tensor:
    """The keypoints (J, 3) moved, thrown, lost and wrongly flagged; see FaultConfig.

    Args:
        sample_id: by which the faults are drawn.
        image_hw: height and width.
        keypoints: (J, 3) x, y in px and 1 if marked.
        faults: the dials.
        seed: another seed makes the same faults elsewhere.

    """
    height, width = image_hw
    count, in_frame = len(keypoints), keypoints[:, :2].any(1)
    marked = keypoints[:, 2] > 0
    chance = {
        name: _draw(sample_id, seed, name, count) < getattr(faults, name)
        for name in ("outliers", "missing", "zeros", "wrong_flags")
    }
    px = keypoints[:, :2] + faults.noise_px * _normal(sample_id, seed, "noise_px", (count, 2))
    by_extent = faults.noise_extent * _extent(keypoints[marked, :2])
    px = px + by_extent * _normal(sample_id, seed, "noise_extent", (count, 2))
    part_of_frame = _draw(sample_id, seed, "anywhere", 2 * count).reshape(count, 2)
    anywhere = part_of_frame * torch.tensor([width, height]) - 0.5
    px = torch.where((marked & chance["outliers"])[:, None], anywhere, px)
    px = torch.where((marked & chance["zeros"])[:, None], 0.0, px)
    flags = marked & ~chance["missing"]
    flags = torch.where(chance["wrong_flags"] & in_frame, ~flags, flags)
    px = torch.where(in_frame[:, None], px, keypoints[:, :2])
    return torch.cat((px, flags[:, None].to(px)), dim=1)


def _extent(pixels: Tensor) -> float:
    """The longer side, px, of the box of points (N, 2); 0 of none."""
    return float((pixels.amax(0) - pixels.amin(0)).max()) if len(pixels) else 0.0


def _misfit(annotation: Annotation, faults: FaultConfig, seed: int) -> SmalParameters:
    """The parameters of the misfitted body: joints turned, its size and its depth changed.

    Its root joint stays on the true one's ray, and at the true depth but for the focal length's
    fault.
    """
    true, model = annotation.parameters, load_quadruped()
    pose = true.pose.clone()
    turns = _normal(annotation.sample_id, seed, "joint_deg", tuple(pose[1:].shape))
    pose[1:] += np.deg2rad(faults.joint_deg) * turns
    betas = faults.body_scale * true.betas
    betas[quadruped_names().columns.index("size")] += _size_amount(model, faults.body_scale)
    before, after = root_joint(model, true.betas), root_joint(model, betas)
    root_cam = before + true.trans
    root_cam = torch.cat((root_cam[:2], root_cam[2:] * faults.focal_factor))
    return replace(true, pose=pose, betas=betas, trans=root_cam - after)


def _size_amount(model: SmalModel, scale: float) -> float:
    """The amount of the shape's column "size" that scales the template by a factor.

    The other columns' amounts are scaled by themselves.
    """
    column = model.shapedirs[:, :, quadruped_names().columns.index("size")]
    growth = float((column * model.v_template).sum() / (model.v_template * model.v_template).sum())
    return (scale - 1) / growth


def _generator(sample_id: str, seed: int, fault: str) -> np.random.Generator:
    """The random numbers of one fault of one sample."""
    return np.random.Generator(
        np.random.PCG64(
            np.random.SeedSequence((seed, zlib.crc32(sample_id.encode()), *fault.encode()))
        )
    )


def _draw(sample_id: str, seed: int, fault: str, count: int) -> Tensor:
    """Random numbers (count,) from 0 to 1, of one fault of one sample."""
    return torch.from_numpy(_generator(sample_id, seed, fault).random(count))


def _normal(sample_id: str, seed: int, fault: str, shape: tuple[int, ...]) -> Tensor:
    """Random numbers of a shape, normally distributed, of one fault of one sample."""
    return torch.from_numpy(_generator(sample_id, seed, fault).standard_normal(shape))
