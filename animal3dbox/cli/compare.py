"""The command `compare`: a detector's boxes beside labels, as tables and as pictures."""

import csv
import io
import sys
from collections.abc import Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np

from animal3dbox.cli.exit_codes import ExitCode
from animal3dbox.cli.export import is_labels, read_cuboids
from animal3dbox.cli.jobs import CompareJob
from animal3dbox.datasets.cuboid_formats import CuboidOptions
from animal3dbox.datasets.exchange.export import in_metres
from animal3dbox.datasets.images.remote_files import PicturePath
from animal3dbox.datasets.readers.kitti.layout import kitti_layout
from animal3dbox.datasets.readers.predictions.camera_poses import Cameras
from animal3dbox.datasets.readers.predictions.reader import read_predictions
from animal3dbox.datasets.readers.predictions.truth import unique_image
from animal3dbox.datasets.records import CuboidImage, CuboidRecord, CuboidSet
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.evaluate.comparison import ComparedBox, compared_boxes, comparison_tables
from animal3dbox.evaluate.comparison_metrics import in_brief, metrics_table
from animal3dbox.evaluate.comparison_pictures import comparison_pictures, png_of
from animal3dbox.evaluate.files import Evaluation, write_json
from animal3dbox.evaluate.page import write_page
from animal3dbox.evaluate.tables import Table
from animal3dbox.files import ListedFiles, user_path, write_whole
from animal3dbox.progress import watched
from animal3dbox.report.gallery import small_picture
from animal3dbox.report.labels_csv import text_cell

SAME_K = 1e-3
"""Greatest difference of two intrinsics that are one, as a part of the focal length."""

PAGE_WIDTH = 420
"""Width of the pictures on the page, px; those in pictures/ are whole."""
PICTURES = r"pictures/[0-9]{4,9}\.png"
"""The paths of the pictures from the folder of the results, in which `label` has overlays/."""


def run_compare(job: CompareJob) -> ExitCode:
    """Match, write the files and say what came out."""
    if job.out.exists() and not job.out.is_dir():
        raise ConfigError(f"--out {job.out} is a file: give a folder")
    if job.pictures < 0:
        raise ConfigError(f"--pictures must not be negative, got {job.pictures}")
    ListedFiles(job.out, "compare", PICTURES).check_list()
    detections = _detections(job)
    labels = _labels(job, detections)
    boxes = compared_boxes(labels, detections)
    summary, every = comparison_tables(boxes)
    metrics = metrics_table(labels, detections)
    files = {image.image_id: image.image_path for image in detections.images}
    pictures, picture_notes = _pictures(job, boxes, files)
    faults = [*labels.faults, *detections.faults]
    notes = [*(f"labels: {one}" for one in labels.notes), *detections.notes, *picture_notes]
    about = {
        "labels": str(job.path),
        "detections": str(job.predictions),
        "layout": detections.name,
        "truth": str(job.truth),
        "faults": [str(fault) for fault in faults],
        "notes": notes,
    }
    evaluation = Evaluation("Detections beside labels: solid labels, dashed detections", about, ())
    evaluation = replace(evaluation, tables=(summary, metrics, every))
    write_json(job.out / "compare.json", evaluation)
    write_whole(job.out / "compare.csv", _csv(every))
    write_page(job.out / "compare.html", evaluation, {}, pictures)
    _print(job, (summary, in_brief(metrics)), notes, faults)
    return ExitCode.FAULTY if faults else ExitCode.OK


def _detections(job: CompareJob) -> CuboidSet:
    """The detections that count, in the truth's images."""
    cameras: Cameras = None
    if job.cameras is not None:
        cameras = "camera" if job.cameras == "camera" else user_path(job.cameras)
    detections = read_predictions(
        job.predictions,
        job.truth,
        layout=job.layout,
        cameras=cameras,
        category_ids=job.category_ids,
        heading_known=None if job.heading == "layout" else job.heading == "known",
        images=job.images,
        metric=job.metric,
    )
    records = tuple(
        one for one in detections.records if one.score is None or one.score >= job.least_score
    )
    left_out = len(detections.records) - len(records)
    note = (f"{left_out} detections have a score below {job.least_score:g}: left out",)
    notes = (*detections.notes, *(note if left_out else ()))
    return replace(detections, records=records, notes=notes)


def _labels(job: CompareJob, detections: CuboidSet) -> CuboidSet:
    """The labels under the names that the truth has for their images."""
    options = (
        CuboidOptions() if is_labels(job.path) else CuboidOptions(_images(job), metric=job.metric)
    )
    labels = read_cuboids(job.path, options)
    if job.metres_per_unit is not None:
        labels = in_metres(labels, job.metres_per_unit)
    by_name = {image.image_id: image for image in detections.images}
    records, notes = [], list(labels.notes)
    elsewhere, other_camera = 0, 0
    for record in labels.records:
        image = _image_of(record, by_name, job.truth)
        if image is None:
            elsewhere += 1
            continue
        other_camera += bool(np.abs(image.K - record.K).max() > SAME_K * image.K[0, 0])
        records.append(replace(record, image_id=image.image_id))
    if elsewhere:
        notes.append(f"{elsewhere} are of images that the truth does not have: left out")
    if other_camera:
        notes.append(
            f"{other_camera} have another K than the truth's image: their boxes are in another"
            " camera's frame, so overlaps in space mean little; detect with the labels' K"
        )
    if elsewhere == len(labels.records) and labels.records:
        return replace(labels, notes=tuple(notes))  # of which compared_boxes tells
    return replace(labels, records=tuple(records), notes=tuple(notes))


def _images(job: CompareJob) -> Path | None:
    """The folder of the labels' pictures: the truth's, but of a folder of KITTI's its own."""
    layout = kitti_layout(job.path)
    has_own = layout is not None and (layout.home / layout.pictures).is_dir()
    return None if has_own else job.images


def _image_of(
    record: CuboidRecord, by_name: dict[str, CuboidImage], truth: Path
) -> CuboidImage | None:
    """The truth's image of a label, whose name may lack the folders before it."""
    exact = by_name.get(record.image_id)
    return exact or unique_image(tuple(by_name.values()), record.image_id, truth)


def _pictures(
    job: CompareJob, boxes: Sequence[ComparedBox], files: dict[str, PicturePath | None]
) -> tuple[dict[str, bytes], list[str]]:
    """The pictures for the page as PNG by image, and notes on them; the whole ones are written.

    Args:
        job: with the folder, and how many are drawn.
        boxes: of all images.
        files: image -> its file.

    """
    picture_files, names = ListedFiles(job.out, "compare", PICTURES), list[str]()
    faults: list[SampleError] = []
    pictures: dict[str, bytes] = {}
    of_images = islice(comparison_pictures(boxes, files, faults), job.pictures)
    total = min(job.pictures, len({box.image_id for box in boxes}))
    for name, picture in watched(of_images, "drawing", unit="picture", total=total):
        names.append(f"pictures/{len(pictures):04d}.png")
        picture_files.write(names[-1], png_of(picture))
        pictures[name] = png_of(small_picture(picture, PAGE_WIDTH))
    picture_files.keep_only(names)
    notes = [f"{len(faults)} pictures are grey: {faults[0]}"] if faults else []
    return pictures, notes


def _csv(table: Table) -> bytes:
    """A table as csv; an empty cell is unknown, and no cell is run by a spreadsheet."""
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(table.columns)
    for row in table.rows:
        writer.writerow([_cell(cell) for cell in row])
    return text.getvalue().encode()


def _cell(cell: str | int | float | None) -> str:
    if cell is None:
        return ""
    return text_cell(cell) if isinstance(cell, str) else f"{cell:.6g}"


def _print(
    job: CompareJob, tables: Sequence[Table], notes: list[str], faults: list[SampleError]
) -> None:
    """What came out, on stdout; notes and faults on stderr."""
    if job.json:
        sys.stdout.write((job.out / "compare.json").read_text())
        return
    print("\n\n".join(table.text() for table in tables))
    print(f"look at {job.out / 'compare.html'}")
    for note in notes:
        print(f"note: {note}", file=sys.stderr)
    for fault in faults:
        print(f"  faulty: {fault}", file=sys.stderr)
