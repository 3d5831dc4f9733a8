"""kornia's AugmentationSequential for pictures with cameras and cuboids.

The same draws, the same geometry, one warp.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.geometry.homography import apply_homography
from animal3dbox.transforms.camera_law.boxes import mapped_boxes
from animal3dbox.transforms.camera_law.consistency import check_consistent
from animal3dbox.transforms.camera_law.law import map_fields
from animal3dbox.transforms.camera_law.relabel import Relabelling, check_keypoint_mirror
from animal3dbox.transforms.camera_law.target_dict import read_target, write_target
from animal3dbox.transforms.kornia_bridge.data_keys import (
    BOX_KEYS,
    KORNIAS,
    checked_images,
    data_key,
)
from animal3dbox.transforms.kornia_bridge.fusion import (
    BatchWarp,
    Stage,
    drawn_stages,
    run_images,
    run_masks,
    whole_map,
)
from animal3dbox.transforms.kornia_bridge.probe import measured_mirror
from animal3dbox.transforms.rendering.sampling import check_interpolation


class CameraAugmentationSequential(torch.nn.Module):
    """A kornia pipeline, unmodified, that keeps cameras and cuboids true and reads the pixels once.

    ``image, K, corners_3d = aug(image, K, corners_3d)`` with ``data_keys=["input", "K",
    "corners_3d"]``, or ``aug({"image": image, "K": K})``. Under the same torch.manual_seed it draws
    what kornia would draw; neighbouring geometric operations are multiplied together, and so are
    those with an unclipped affine operation on colours between them (LINEAR). Any other operation
    on colours is kornia's own, in its place. What lies outside the picture is filled once, at the
    end.

    Args:
        ops: kornia augmentations, or one kornia AugmentationSequential.
        data_keys: names out of data_keys.SHAPES ("image" is "input"), one an argument.
        keypoint_mirror: (J,) for each keypoint its counterpart on the other side; needed for
            keypoints if an operation may mirror.
        mirror: "relabel", or "forbid" to refuse operations that may mirror.
        allow_skew: let the camera get a skew K[0, 1].
        interpolation: "bilinear", "bicubic" or "nearest", whatever the operations' own; masks are
            nearest.
        fill: of what lies outside the picture, in the image's own units, one or one a channel.
        check: compare corners_2d, cuboids and K with each other first, so that a stale camera is
            found.
        options: of AugmentationSequential, such as random_apply or same_on_batch.

    Attributes:
        transform_matrix: (B, 3, 3) what the last call did to pixels, in the image's dtype; None
            before.

    Raises:
        ConfigError: an operation cannot say what it does to the camera, or a key is not known.

    Example:
        >>> import kornia.augmentation as kornia
        >>> flip = kornia.RandomHorizontalFlip(p=1.0)
        >>> aug = CameraAugmentationSequential(flip, data_keys=["input", "K"])
        >>> K = torch.tensor([[[90.0, 0, 44.5], [0, 90, 29.5], [0, 0, 1]]])
        >>> images, K_new = aug(torch.zeros(1, 3, 60, 80), K)
        >>> K_new[0, 0].tolist()  # cx' = 79 - cx
        [90.0, 0.0, 34.5]
    """

    def __init__(
        self,
        *ops: Any,
        data_keys: Sequence[Any] | None = ("input",),
        keypoint_mirror: Sequence[int] | None = None,
        mirror: str = "relabel",
        allow_skew: bool = False,
        interpolation: str = "bilinear",
        fill: float | tuple[float, ...] = 0.0,
        check: bool = True,
        **options: Any,
    ) -> None:
        super().__init__()
        if mirror not in ("relabel", "forbid"):
            raise ConfigError(f"mirror must be 'relabel' or 'forbid', got {mirror!r}")
        self.pipeline = _pipeline(ops, options)
        self.data_keys = None if data_keys is None else [data_key(name) for name in data_keys]
        self.mirrors = {name: measured_mirror(op) for name, op in self.pipeline.named_children()}
        guilty = [
            type(self.pipeline.get_submodule(name)).__name__
            for name, may_mirror in self.mirrors.items()
            if may_mirror
        ]
        if mirror == "forbid" and guilty:
            raise ConfigError(
                f"mirror='forbid', but these may mirror: {', '.join(guilty)}; take them out"
            )
        self.keypoint_mirror = (
            None if keypoint_mirror is None else torch.tensor(list(keypoint_mirror))
        )
        if self.keypoint_mirror is not None:
            check_keypoint_mirror(self.keypoint_mirror, len(self.keypoint_mirror))
        self.allow_skew, self.check = allow_skew, check
        self.interpolation = check_interpolation(interpolation)
        self.fill = fill if isinstance(fill, tuple) else (float(fill),)
        self.transform_matrix: Tensor | None = None
        self._params: Sequence[Any] | None = None
        self._last_map: tuple[BatchWarp, tuple[int, int]] | None = None

    def forward(
        self,
        *args: Any,
        params: Sequence[Any] | None = None,
        data_keys: Sequence[Any] | None = None,
    ) -> Any:
        """Augment a batch of images and all that is known about them.

        Args:
            args: one tensor a data key, or one dict.
            params: drawn before (aug._params), to replay; None draws anew.
            data_keys: for this call.

        Returns:
            The tensors in the same order, in a list if there are several, or a dict; each of the
            dtype that came.

        """
        keys, names, values = self._named(args, data_keys)
        images = checked_images(values)
        self._params = self.pipeline.forward_parameters(images.shape) if params is None else params
        shape = (images.shape[0], images.shape[1], images.shape[2], images.shape[3])
        stages = drawn_stages(self.pipeline, self._params, shape)
        self._last_map = (whole_map(stages, shape[0], shape[2:]), shape[2:])
        results = self._mapped(values, stages)
        self.transform_matrix = self._matrix(self._last_map[0], images)
        return _as_given(args, keys, names, results)

    def inverse(self, *args: Any, data_keys: Sequence[Any] | None = None) -> Any:
        """Take images, and all that is known about them, back to before the last call.

        What the last call cut off is gone: it is filled, and boxes that were clipped stay so.
        Colours stay as they are.

        Args:
            args: as of forward, of the size that the last call gave.
            data_keys: for this call.

        Raises:
            ConfigError: there was no call, or the images are of another number or size.

        Example:
            >>> import kornia.augmentation as kornia
            >>> aug = CameraAugmentationSequential(kornia.RandomHorizontalFlip(p=1.0))
            >>> images = torch.rand(1, 3, 60, 80)
            >>> bool((aug.inverse(aug(images)) - images).abs().max() < 1e-4)
            True
        """
        if self._last_map is None:
            raise ConfigError("inverse needs a call before it, whose maps it takes back")
        keys, names, values = self._named(args, data_keys)
        images = checked_images(values)
        last, image_hw = self._last_map
        if (len(images), tuple(images.shape[2:])) != (len(last.H_out_in), tuple(last.image_hw)):
            raise ConfigError(
                f"inverse needs the {len(last.H_out_in)} images of {tuple(last.image_hw)} that the"
                f" last call gave, got {len(images)} of {tuple(images.shape[2:])}"
            )
        back = BatchWarp(np.linalg.inv(last.H_out_in), image_hw)
        return _as_given(args, keys, names, self._mapped(values, [back]))

    def _named(
        self, args: tuple[Any, ...], data_keys: Sequence[Any] | None
    ) -> tuple[list[Any], list[str], dict[str, Any]]:
        """The keys of a call as they were given, their names, and the values by these."""
        as_dict = len(args) == 1 and isinstance(args[0], Mapping)
        keys = list(args[0]) if as_dict else list(data_keys or self.data_keys or ())
        names = [data_key(name) for name in keys]
        values = list(args[0].values()) if as_dict else list(args)
        if len(names) != len(values) or len(set(names)) != len(names):
            raise ConfigError(
                f"data_keys must name each argument once, got {keys} for {len(values)} arguments"
            )
        if "keypoints" in names and any(self.mirrors.values()) and self.keypoint_mirror is None:
            raise ConfigError(
                "keypoints under a mirror change their names: give keypoint_mirror=[...], each"
                " one's counterpart on the other side"
            )
        return keys, names, dict(zip(names, values, strict=True))

    @staticmethod
    def _matrix(batch_warp: BatchWarp, images: Tensor) -> Tensor:
        """The maps of a batch as a tensor like its images."""
        return torch.from_numpy(batch_warp.H_out_in.copy()).to(images)

    def _mapped(self, values: dict[str, Any], stages: list[Stage]) -> dict[str, Any]:
        """Every value of a batch after the stages."""
        images = values["input"]
        image_hw = (images.shape[2], images.shape[3])
        batch_warp = whole_map(stages, images.shape[0], image_hw)
        H = torch.from_numpy(batch_warp.H_out_in.copy()).to(images.device)
        if bool((torch.linalg.det(H) < 0).any()) and not any(self.mirrors.values()):
            raise ConfigError(
                "the pipeline mirrored a picture although none of its operations was known to"
                " mirror"
            )
        results: dict[str, Any] = self._mapped_targets(values, H, image_hw, batch_warp) | {
            "input": run_images(images, stages, self.interpolation, self.fill)
        }
        if "mask" in values:
            results["mask"] = run_masks(values["mask"], stages)
        if "keypoints" in values:
            results["keypoints"] = self._mapped_keypoints(values["keypoints"], H)
        for name in BOX_KEYS:
            if name in values:
                results[name] = _mapped_boxes(values[name], H, batch_warp.image_hw)
        if "class" in values:
            results["class"] = values["class"]
        return results

    def _mapped_targets(
        self, values: dict[str, Tensor], H: Tensor, image_hw: tuple[int, int], batch_warp: BatchWarp
    ) -> dict[str, Tensor]:
        """Cameras and cuboids, picture by picture, by the law."""
        named = {name: value for name, value in values.items() if name not in KORNIAS}
        still = torch.eye(3, dtype=torch.float64, device=H.device)
        rows = []
        for row in range(H.shape[0] if named else 0):
            fields = read_target(
                {
                    **{name: value[row] for name, value in named.items()},
                    "image_id": f"picture {row} of the batch",
                },
                image_hw,
            )
            if self.check:
                check_consistent(fields)
            if batch_warp.image_hw != image_hw or not torch.equal(H[row], still):
                fields = map_fields(
                    fields,
                    batch_warp.H_out_in[row],
                    batch_warp.image_hw,
                    allow_skew=self.allow_skew,
                )
            rows.append(write_target(fields))
        return {
            name: torch.stack([torch.as_tensor(target[name]) for target in rows]) for name in named
        }

    def _mapped_keypoints(self, keypoints: Tensor, H: Tensor) -> Tensor:
        """Keypoints (B, J, 2), wherever they come to lie, renamed under a mirror."""
        points = keypoints.double()
        w = (points * H[:, None, 2, :2]).sum(-1) + H[:, None, 2, 2]
        if bool((w <= 0).any()):
            row = int((w <= 0).any(-1).nonzero()[0])
            raise SampleError(
                f"picture {row} of the batch",
                "keypoints",
                "one lies beyond the map's horizon; narrow the perspective or leave it out",
            )
        mapped = apply_homography(H, points)
        if self.keypoint_mirror is not None:
            mapped = Relabelling(torch.linalg.det(H) < 0).keypoints(mapped, self.keypoint_mirror)
        return mapped.to(keypoints.dtype)


def _mapped_boxes(
    boxes: Tensor | Sequence[Tensor], H: Tensor, image_hw: tuple[int, int]
) -> Tensor | list[Tensor]:
    """2D boxes of a batch, as xyxy or four corners, inside the new frame; a list stays a list."""
    rows = []
    for row, box in enumerate(boxes):
        with_corners = box.ndim == 3
        xyxy = torch.cat((box.amin(1), box.amax(1)), -1) if with_corners else box
        mapped = mapped_boxes(xyxy.double(), H[row], image_hw, None)
        if with_corners:  # top left, then clockwise, as kornia gives them
            mapped = mapped[:, [0, 1, 2, 1, 2, 3, 0, 3]].reshape(-1, 4, 2)
        rows.append(mapped.to(box.dtype))
    return torch.stack(rows) if isinstance(boxes, Tensor) else rows


def _as_given(
    args: tuple[Any, ...], keys: Sequence[Any], names: Sequence[str], results: Mapping[str, Any]
) -> Any:
    """The results as a dict, a list, or the only one, as the arguments were given."""
    if len(args) == 1 and isinstance(args[0], Mapping):
        return {name: results[key] for name, key in zip(keys, names, strict=True)}
    return results[names[0]] if len(names) == 1 else [results[name] for name in names]


def _pipeline(ops: Sequence[Any], options: dict[str, Any]) -> Any:
    """Kornia's own container of the operations."""
    import kornia.augmentation as kornia

    if len(ops) == 1 and isinstance(ops[0], kornia.AugmentationSequential):
        if options:
            raise ConfigError(
                f"options {sorted(options)} belong to the AugmentationSequential that was given:"
                " set them there"
            )
        return ops[0]
    return kornia.AugmentationSequential(*ops, **options)
