"""Views of stored crops by cameras of their own: what a detector is shown, and what is true of it.

Crops are cut out once, wider than a network sees them; each step of training then looks at them
anew, a whole batch at a time, by the camera law: no picture is opened again.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import grid_sample

from animal3dbox.errors import ConfigError, ShapeError
from animal3dbox.geometry.checks import check_shape
from animal3dbox.geometry.homography import apply_homography, update_camera
from animal3dbox.geometry.rigid_transforms import rotation_from_axis_angle


@dataclass(frozen=True, kw_only=True)
class CropViews:
    """The views that a network is shown of square crops of animals.

    A plain view is the middle of its crop. A drawn one is what another camera sees at the crop's
    place: turned by up to `turn_deg` about its right, down and forward axes, mirrored, nearer or
    farther, its aim shifted. K, centre and rotation are that camera's, exactly
    (animal3dbox.geometry.homography); the 2D box of every view is the view itself, so that BoxCoder
    tells places in it.

    Attributes:
        side: of the views in px.
        mirror: whether half of the drawn views are mirrored.
        zoom: greatest logarithm of the scale, to either side.
        shift: greatest shift along each side, as a part of it.
        turn_deg: greatest turns about x, y and z, to either side.
        colour: greatest change of brightness, and of contrast, as a part of them.

    Raises:
        ConfigError: an option cannot be.

    Example:
        >>> K = torch.tensor([[500.0, 0, 47.5], [0, 500, 47.5], [0, 0, 1]])
        >>> fields = {"K": K[None], "center": torch.tensor([[0.1, 0, 8]])}
        >>> fields["rotation"] = torch.eye(3)[None]
        >>> crops = torch.zeros(1, 3, 96, 96, dtype=torch.uint8)
        >>> pixels, seen = CropViews(side=64).plain(crops, fields)
        >>> pixels.shape, seen["K"][0, :2, 2].tolist(), seen["boxes"].tolist()
        (torch.Size([1, 3, 64, 64]), [31.5, 31.5], [[-0.5, -0.5, 63.5, 63.5]])
    """

    side: int = 64
    mirror: bool = True
    zoom: float = 0.1
    shift: float = 0.06
    turn_deg: tuple[float, float, float] = (10.0, 10.0, 15.0)
    colour: float = 0.3

    def __post_init__(self) -> None:
        if self.side < 1 or min(self.zoom, self.shift, self.colour, *self.turn_deg) < 0:
            raise ConfigError(
                "side must be positive, and zoom, shift, turn_deg and colour not negative, got"
                f" {self.side}, {self.zoom}, {self.shift}, {self.turn_deg} and {self.colour}"
            )
        if max(self.turn_deg) > 45 or self.colour >= 1:
            raise ConfigError(
                "turn_deg must be 45 at most, or crops would turn out of sight, and colour below 1,"
                f" got {self.turn_deg} and {self.colour}"
            )

    def plain(
        self, crops: Tensor, fields: Mapping[str, Tensor]
    ) -> tuple[Tensor, dict[str, Tensor]]:
        """The middles of crops.

        Args:
            crops: (N, 3, s, s) uint8, s at least `side`.
            fields: `K` (N, 3, 3) of the crops, `center` (N, 3), `rotation` (N, 3, 3); others are
                passed on.

        Returns:
            (N, 3, side, side) from -1 to 1, and the fields as the views' cameras see them, with
            their `boxes`.

        Raises:
            ShapeError: crops are not square, or smaller than the views.

        """
        edge = self._edge(crops)
        H = torch.eye(3).to(fields["K"]).repeat(len(crops), 1, 1)
        H[:, :2, 2] = -edge
        inner = slice(edge, edge + self.side)
        return crops[:, :, inner, inner] / 127.5 - 1, self._seen(H, fields)

    def drawn(
        self, crops: Tensor, fields: Mapping[str, Tensor], generator: torch.Generator
    ) -> tuple[Tensor, dict[str, Tensor]]:
        """Views by cameras that are drawn at random, one a crop; see `plain`.

        Beyond the crop a view is black, as crops are beyond their picture.
        """
        self._edge(crops)
        count, K = len(crops), fields["K"]
        draw = (torch.rand(count, 9, generator=generator) * 2 - 1).to(K)
        turn = rotation_from_axis_angle(draw[:, :3] * draw.new_tensor(self.turn_deg).deg2rad())
        turned = K @ turn @ K.inverse()
        scale = torch.exp(self.zoom * draw[:, 3])
        H = torch.eye(3).to(K).repeat(count, 1, 1)
        H[:, 0, 0] = torch.where((draw[:, 4] > 0) & self.mirror, -scale, scale)
        H[:, 1, 1] = scale
        middle = apply_homography(H @ turned, K.new_full((count, 1, 2), (crops.shape[-1] - 1) / 2))
        H[:, :2, 2] = (self.side - 1) / 2 - middle[:, 0] + self.shift * self.side * draw[:, 5:7]
        H = H @ turned
        contrast, brightness = (1 + self.colour * draw[:, 7:, None, None, None]).unbind(1)
        pixels = self._sampled(crops, H.inverse())
        return pixels.mul_(contrast * brightness / 127.5).sub_(contrast), self._seen(H, fields)

    def _edge(self, crops: Tensor) -> int:
        """The px beside the middle that a plain view leaves out on the left and above."""
        check_shape("crops", crops, "N 3 H W")
        height, width = crops.shape[-2:]
        if height != width or width < self.side:
            raise ShapeError(
                f"crops must be square and have {self.side} px at least, got {height} x {width}"
            )
        return (crops.shape[-1] - self.side) // 2

    def _sampled(self, crops: Tensor, H_in_out: Tensor) -> Tensor:
        """The pixels of views, (N, 3, side, side) from 0 to 255, by maps from view to crop."""
        steps = torch.arange(self.side).to(H_in_out)
        y, x = torch.meshgrid(steps, steps, indexing="ij")
        places = apply_homography(H_in_out, torch.stack((x, y), -1).view(1, -1, 2))
        # grid_sample counts from -1 to 1 over the outer edges of pixels
        grid = places.mul_(2 / crops.shape[-1]).add_(1 / crops.shape[-1] - 1)
        grid = grid.view(-1, self.side, self.side, 2).float()
        return grid_sample(crops.float(), grid, align_corners=False)

    def _seen(self, H: Tensor, fields: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """The fields of the cameras that take the views, by the law."""
        camera = update_camera(H, fields["K"], fields["rotation"], fields["center"])
        frame = H.new_tensor([-0.5, -0.5, self.side - 0.5, self.side - 0.5]).expand(len(H), 4)
        changed = {"K": camera.K, "rotation": camera.R, "center": camera.t, "boxes": frame}
        # R and t are there, since both were given
        return {**fields, **{name: value for name, value in changed.items() if value is not None}}
