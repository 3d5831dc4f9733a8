"""The reader of cuboids in KITTI's text files: labels, detectors' results and tracking."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from animal3dbox.datasets.images.photos import stored_size
from animal3dbox.datasets.readers.cuboid_checks import (
    Metric,
    check_metric,
    check_pixels,
    size_note,
    without_repeats,
)
from animal3dbox.datasets.readers.cuboid_conventions import KITTI, Floats
from animal3dbox.datasets.readers.kitti.checks import (
    AS_DOCUMENTED,
    StatedLine,
    box_problems,
    check_line,
)
from animal3dbox.datasets.readers.kitti.files import (
    NO_LOCATION,
    VISIBILITY,
    KittiLine,
    parsed_calibration,
    parsed_images,
    parsed_line,
    states_heading,
    states_metres,
)
from animal3dbox.datasets.readers.kitti.layout import INDEX, KittiLayout, kitti_layout
from animal3dbox.datasets.records import CuboidImage, CuboidRecord, CuboidSet
from animal3dbox.datasets.sightings import NO_SIGHTING, Sighting
from animal3dbox.errors import DatasetFormatError, DatasetNotFoundError, SampleError, ShapeError
from animal3dbox.files import user_path
from animal3dbox.geometry.checks import check_intrinsics
from animal3dbox.progress import watched

FORMAT = "kitti"
"""The format's name in reports."""
NO_REGION = "DontCare"
"""Category of the regions that KITTI leaves out of its evaluation."""


@dataclass
class _Reading:
    """What is read of a folder so far.

    Attributes:
        layout: where its files are.
        images: the user's folder of images; None: the usual one.
        listed: of images.txt, number -> size and path; None without.
        lines: sound by themselves.
        by_id: every usable image.
        faults: one error a line or image that is unusable.
        counts: what was left out.
    """

    layout: KittiLayout
    images: Path | None
    listed: dict[str, tuple[tuple[int, int], str]] | None
    lines: list[StatedLine] = field(default_factory=list)
    by_id: dict[str, CuboidImage] = field(default_factory=dict)
    faults: list[SampleError] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)


def read_kitti(
    folder: Path | str,
    images: Path | str | None = None,
    *,
    heading_known: bool | None = None,
    metric: Metric = "info",
) -> CuboidSet:
    """The cuboids of a folder with label_2/ and calib/, and images.txt or image_2/.

    Lines may be labels (15 columns), a detector's results (16, with a score) or tracking (17 or 18,
    of label_02/ and image_02/). Their fields are held against each other: what contradicts itself
    is a fault that names the likely cause.

    Args:
        folder: such as KITTI's own training/, or a folder of results beside calib/.
        images: the folder of pictures; None: image_2/ or image_02/.
        heading_known: whether forward means something; None: it does, as for KITTI's cars, unless
            images.txt of this package says otherwise.
        metric: whether lengths are metres: "yes", "no", or "info": they are, as KITTI's always are,
            unless images.txt of this package says otherwise.

    Returns:
        The boxes in the frame of camera 2; DontCare regions and boxes without a 3D location are
        left out and counted.

    Raises:
        ConfigError: another word for metric.
        DatasetNotFoundError: no label files.
        DatasetFormatError: images.txt is there and damaged.

    Example:
        >>> import tempfile
        >>> from animal3dbox.datasets import CuboidRecord, CuboidSet, write_kitti
        >>> K = np.array([[500.0, 0, 319.5], [0, 500, 239.5], [0, 0, 1]])
        >>> car = CuboidRecord(
        ...     sample_id="a.jpg",
        ...     image_id="a.jpg",
        ...     image_path=None,
        ...     image_hw=(480, 640),
        ...     category="Car",
        ...     K=K,
        ...     center=np.array([1.0, 0.5, 20.0]),
        ...     rotation=np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]),
        ...     size=np.array([4.0, 1.6, 1.5]),
        ... )
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     _ = write_kitti(CuboidSet("cars", (car,), ()), Path(folder))
        ...     boxes = read_kitti(Path(folder))
        >>> boxes.records[0].category, boxes.records[0].center.round(6).tolist()
        ('Car', [1.0, 0.5, 20.0])

    """
    check_metric(metric)
    folder, images = user_path(folder), None if images is None else user_path(images)
    if not folder.is_dir():
        raise DatasetNotFoundError(f"there is no folder {folder}")
    layout = kitti_layout(folder)
    if layout is None:
        raise DatasetNotFoundError(
            f"{folder} has no label_2/*.txt (nor label_02/, nor results beside calib/)"
        )
    index = layout.home / INDEX
    text = _text(index) if index.is_file() else None
    reading = _Reading(layout, images, _listed(text, folder))
    for label in watched(layout.labels, "reading", unit="file"):
        _read_label(label, reading)
    is_metric = (text is None or states_metres(text)) if metric == "info" else metric == "yes"
    if heading_known is None:
        heading_known = text is None or states_heading(text)
    records = [
        _record(stated, heading_known=heading_known, metric=is_metric) for stated in reading.lines
    ]
    problems = box_problems(reading.lines, records, own=text is not None)
    sound = [record for number, record in enumerate(records) if number not in problems]
    kept, repeats = without_repeats(sound)
    left_out = tuple(f"{count} {kind} were left out" for kind, count in reading.counts.items())
    return CuboidSet(
        name=FORMAT,
        records=kept,
        faults=(*reading.faults, *problems.values(), *repeats),
        notes=(*left_out, *(size_note(kept) if metric != "no" and is_metric else ())),
        images=tuple(reading.by_id.values()),
    )


def _text(path: Path) -> str:
    """The text of a file, without the mark of UTF-8 (BOM) that some editors put before it."""
    return path.read_text(encoding="utf-8-sig", errors="replace")


def _listed(text: str | None, folder: Path) -> dict[str, tuple[tuple[int, int], str]] | None:
    """The images of images.txt, if there is one; raises DatasetFormatError if it is damaged."""
    try:
        return None if text is None else parsed_images(text)
    except SampleError as error:
        raise DatasetFormatError(f"{folder}: {error}") from error


def _read_label(label: Path, reading: _Reading) -> None:
    """Read one file of boxes, an image's or a sequence's."""
    lines = [line for line in _text(label).splitlines() if line.strip()]
    parsed: dict[int | None, list[KittiLine | SampleError]] = {}
    for number, text in enumerate(lines):
        try:
            line = parsed_line(text, f"{label.stem} (line {number + 1})")
            parsed.setdefault(line.frame, []).append(line)
        except SampleError as error:
            parsed.setdefault(next(iter(parsed), None), []).append(error)
    for frame, members in parsed.items() or {None: []}.items():
        _read_frame(label.stem, frame, members, reading)


def _read_frame(
    stem: str, frame: int | None, members: Sequence[KittiLine | SampleError], reading: _Reading
) -> None:
    """Read the lines of one image; an unusable one is a fault, and its lines are counted."""
    try:
        image, offset = _image(stem, frame, reading)
    except SampleError as error:
        reading.faults.append(error)
        if members:
            reading.counts["lines of unusable images"] += len(members)
        return
    reading.by_id[image.image_id] = image
    number = 0
    for line in members:
        sample_id = f"{image.image_id}#{number}" if number else image.image_id
        if isinstance(line, SampleError):
            reading.faults.append(SampleError(sample_id, line.field, line.problem))
        elif (kind := _left_out(line)) is not None:
            reading.counts[kind] += 1
            continue
        else:
            stated = StatedLine(sample_id, image, line, offset)
            try:
                check_line(stated)
                reading.lines.append(stated)
            except SampleError as error:
                reading.faults.append(error)
        number += 1


def _left_out(line: KittiLine) -> str | None:
    """The kind of a line that states no box, for the note; None of one that does."""
    if line.kind == NO_REGION:
        return "DontCare regions"
    if (line.location == NO_LOCATION).any() or (line.dimensions == -1).all():
        return "boxes without a 3D location"
    return None


def _image(stem: str, frame: int | None, reading: _Reading) -> tuple[CuboidImage, Floats]:
    """The image of lines, and the place (3,) of the first camera in the image's frame.

    Raises:
        SampleError: the image or its calibration is missing or damaged.

    """
    layout = reading.layout
    path = layout.picture(stem, frame, reading.images)
    name = path.name if frame is None else f"{stem}/{path.name}"
    name = name if reading.images else f"{layout.pictures}/{name}"
    if reading.listed is None:
        image_hw = stored_size(path, name)
    elif stem not in reading.listed:
        raise SampleError(stem, INDEX, "does not list it")
    else:
        image_hw, name = reading.listed[stem]
        path = path if path.is_file() else layout.home / name
    P = _calibration(layout.home / "calib" / f"{stem}.txt", name)
    check_pixels(P[:, :3], image_hw, name, "P2")
    # P [X; 1] = K (X + o), so the first camera's frame is moved by o = K⁻¹ P[:, 3] into camera 2's.
    offset = np.asarray(np.linalg.solve(P[:, :3], P[:, 3]), dtype=np.float64)
    return CuboidImage(name, path, image_hw, KITTI.K_in(P[:, :3])), offset


def _calibration(path: Path, sample_id: str) -> Floats:
    """The projection matrix P2 (3, 4) of a calibration file, whose intrinsics are ones.

    Raises:
        SampleError: it is missing or damaged.

    """
    try:
        P = parsed_calibration(_text(path), sample_id)
        check_intrinsics("P2", KITTI.K_in(P[:, :3]))
    except OSError as error:
        raise SampleError(sample_id, "calib", f"cannot be read: {error}") from error
    except ShapeError as error:
        raise SampleError(sample_id, "P2", str(error)) from error
    return P


def _sighting(line: KittiLine, image: CuboidImage) -> Sighting:
    """The sequence and the track of a line of tracking."""
    if line.track is None:
        return NO_SIGHTING
    return Sighting(sequence=Path(image.image_id).parent.name, track=str(line.track))


def _record(stated: StatedLine, *, heading_known: bool, metric: bool) -> CuboidRecord:
    """The record of a line that is sound by itself."""
    center, rotation, size = AS_DOCUMENTED.box(stated)
    image, line = stated.image, stated.line
    return CuboidRecord(
        sample_id=stated.sample_id,
        image_id=image.image_id,
        image_path=image.image_path,
        image_hw=image.image_hw,
        category=line.kind,
        K=image.K,
        center=center,
        rotation=rotation,
        size=size,
        metric=metric,
        heading_known=heading_known,
        box=KITTI.boxes_2d_in(line.box) if (line.box[2:] > line.box[:2]).all() else None,
        truncation=line.truncation,
        visibility=VISIBILITY.get(line.occluded),
        score=line.score,
        sighting=_sighting(line, image),
    )
