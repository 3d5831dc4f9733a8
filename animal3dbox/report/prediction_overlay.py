"""A detector's cuboids drawn beside those of the target: the label solid, the detection dashed."""

import torch

from animal3dbox.errors import SampleError
from animal3dbox.report.inset import Picture
from animal3dbox.report.overlay import DrawnCuboid, cuboids_in_picture, with_words
from animal3dbox.report.target_boxes import Fields, checked_field, cuboids_of, picture_of


def draw_predictions(
    image: torch.Tensor | Picture,
    target: Fields,
    prediction: Fields,
    *,
    least_score: float = 0.3,
) -> Picture:
    """The picture with a target's cuboids, solid, and those of a detector, dashed; a new array.

    Front is green and back blue on both, and an arrow in each box points to its front, so that a
    box that looks the wrong way is seen at once. Animals below a sixth of the picture's width are
    shown enlarged in a corner too, two at most.

    Args:
        image: (3, H, W) uint8, as a Dataset gives it, or (H, W, 3) uint8 RGB.
        target: a Dataset's, with `center`, `rotation`, `size` (N of each) and `K`.
        prediction: the same fields and `scores` (M,); drawn with the target's K. Boxes that are
            none (not finite, no rotation, a negative size) are left out and counted in the words.
        least_score: detections of lower scores are left out.

    Returns:
        (H', W', 3) uint8 RGB; enlarged if it was small, with a line of words below.

    Raises:
        SampleError: a field is missing or of the wrong shape.

    Example:
        >>> target = {
        ...     "center": torch.tensor([[0.0, 0, 5]]),
        ...     "rotation": torch.eye(3)[None],
        ...     "size": torch.tensor([[2.0, 1, 1]]),
        ...     "K": torch.tensor([[100.0, 0, 79.5], [0, 100, 59.5], [0, 0, 1]]),
        ... }
        >>> prediction = {**target, "scores": torch.tensor([0.9])}
        >>> image = torch.zeros(3, 120, 160, dtype=torch.uint8)
        >>> draw_predictions(image, target, prediction).shape
        (388, 480, 3)
    """
    picture = picture_of(image)
    image_id = str(target.get("image_id", "target"))
    if "K" not in target:
        raise SampleError(image_id, "target K", "is missing, and nothing can be drawn without it")
    K = target["K"].detach().double().cpu()
    animals = cuboids_of(target, image_id, "target")
    boxes = cuboids_of(prediction, image_id, "prediction")
    scores = checked_field(prediction, image_id, "prediction", name="scores", spec="M").tolist()
    detections = [
        cuboid for cuboid, score in zip(boxes, scores, strict=True) if score >= least_score
    ]
    drawn = [
        DrawnCuboid(cuboid, K, dashed=dashed)
        for cuboids, dashed in ((animals, False), (detections, True))
        for cuboid in cuboids
        if cuboid is not None
    ]
    broken = sum(cuboid is None for cuboid in detections)
    words = f"{len(animals)} labelled, {len(detections)} detected (dashed, score {least_score}+)"
    canvas = cuboids_in_picture(picture, drawn)
    return with_words(canvas, [f"{words}, {broken} of them no boxes" if broken else words])
