"""The command `export`: labels, or cuboids in any format that is read, for other people's tools."""

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from animal3dbox.cli.exit_codes import ExitCode
from animal3dbox.cli.jobs import ExportJob
from animal3dbox.datasets.cuboid_formats import (
    CuboidOptions,
    cuboid_format,
    read_cuboid_set,
)
from animal3dbox.datasets.exchange.animal3d_writer import check_fits_of_model, write_animal3d_fits
from animal3dbox.datasets.exchange.coco_writer import write_coco
from animal3dbox.datasets.exchange.export import ExportSummary, in_metres
from animal3dbox.datasets.exchange.kitti_writer import write_kitti
from animal3dbox.datasets.exchange.omni3d_writer import write_omni3d
from animal3dbox.datasets.exchange.oracle2d_writer import write_oracle2d
from animal3dbox.datasets.exchange.quadruped_file import write_quadruped
from animal3dbox.datasets.formats import path_summary
from animal3dbox.datasets.images.named_files import resolve_inside
from animal3dbox.datasets.images.remote_files import (
    PicturePath,
    PictureUrl,
    check_remote_extra,
    is_remote,
)
from animal3dbox.datasets.records import CuboidRecord, CuboidSet
from animal3dbox.errors import (
    ConfigError,
    DatasetFormatError,
    DatasetNotFoundError,
    SampleError,
)
from animal3dbox.plurals import counted
from animal3dbox.report.ecology.camtrap_observations import write_camtrap_dp
from animal3dbox.report.ecology.wbia import write_wbia
from animal3dbox.report.ecology.wildlife_datasets import write_wildlife_datasets
from animal3dbox.report.label_cuboids import read_label_cuboids
from animal3dbox.report.label_files import labels_file
from animal3dbox.report.label_fits import read_label_fits
from animal3dbox.report.label_reading import read_label_rows
from animal3dbox.smal.files.model_files import load_model

FILE_NAME = "annotations.json"
"""Name of the JSON of cuboids if --out is a folder."""
FITS = ("animal3d", "quadruped")
"""Formats of fitted bodies' parameters; those of ROWS are of labels, the others of cuboids."""
ROWS = {
    "camtrap-dp": "observations.csv",
    "wildlife-datasets": "metadata.csv",
    "wbia": "annotations.json",
}
"""Formats of labels for ecologists -> name of the file if --out is a folder."""


def run_export(job: ExportJob) -> ExitCode:
    """Read cuboids, write them in another format, and say what was lost."""
    if job.metres_per_unit is not None and job.scale_free:
        raise ConfigError(
            "--metres-per-unit says the scale, --scale-free that there is none: give one of them"
        )
    if job.datapackage is not None and job.to != "camtrap-dp":
        raise ConfigError("--datapackage is for --to camtrap-dp")
    if job.to in FITS:
        return _export_fits(job)
    if job.to in ROWS:
        return _export_rows(job)
    if job.model is not None:
        raise ConfigError("--model is for --to animal3d, which poses the fits of a SMAL model")
    cuboids = _cuboids_of(job)
    if not cuboids.records and not cuboids.images:
        raise DatasetFormatError(
            f"{job.path} holds no box that could be written ({len(cuboids.faults)} faulty)"
        )
    for note in cuboids.notes:
        print(note, file=sys.stderr)
    exported = _written(
        cuboids if job.metres_per_unit is None else in_metres(cuboids, job.metres_per_unit), job
    )
    print(
        f"{counted(exported.boxes, 'box', 'boxes')} in {counted(exported.images, 'image')} written"
        f" as {job.to}:"
        f" {', '.join(map(str, exported.files))}; an export to be joined with this one goes on with"
        f" --first-id {exported.next_id}"
    )
    return _print_losses(exported, cuboids.faults)


def _cuboids_of(job: ExportJob) -> CuboidSet:
    """The cuboids to write; KITTI's pictures of labels are in the folder that --images names.

    Those at URLs are fetched from there.
    """
    if job.to != "kitti" or not is_labels(job.path):
        return read_cuboids(job.path, CuboidOptions(job.images, metric=job.metric))
    cuboids = read_cuboids(job.path, CuboidOptions(metric=job.metric))
    records = (
        replace(record, image_path=_picture(record, job.images)) for record in cuboids.records
    )
    return replace(cuboids, records=tuple(records))


def _picture(record: CuboidRecord, images: Path | None) -> PicturePath | None:
    """The URL of a label's image, or its file in the user's folder.

    None, which is noted, if there is none; a ConfigError if URLs cannot be read here.
    """
    if is_remote(record.image_id):
        check_remote_extra()
        return PictureUrl(record.image_id)
    if images is None:
        return None
    try:
        return resolve_inside(images, record.image_id, record.sample_id, "image")
    except SampleError:
        return None


def _export_rows(job: ExportJob) -> ExitCode:
    """Write labels for an ecologist's tools, and say what could not be written."""
    _refuse_options_of_cuboids(job, "labels are written in the scale that they have")
    if job.model is not None:
        raise ConfigError("--model is for --to animal3d, which poses the fits of a SMAL model")
    if not is_labels(job.path):
        raise ConfigError(f"--to {job.to} writes labels, and {job.path} is none")
    if job.to == "camtrap-dp" and job.datapackage is None:
        raise ConfigError(
            "--to camtrap-dp needs --datapackage, the folder of your datapackage.json: observations"
            " copy the IDs and times of its media"
        )
    file, faults = read_label_rows(labels_file(job.path))
    name = ROWS[job.to]
    if job.out.suffix and job.out.suffix.lower() != Path(name).suffix and not job.out.is_dir():
        raise ConfigError(f"--out {job.out}: --to {job.to} writes a {Path(name).suffix} file")
    is_file = job.out.suffix.lower() == Path(name).suffix and not job.out.is_dir()
    path = job.out if is_file else job.out / name
    if job.datapackage is not None:
        exported = write_camtrap_dp(file.animals, job.datapackage, path)
    elif job.to == "wbia":
        exported = write_wbia(file.animals, path)
    else:
        exported = write_wildlife_datasets(file.animals, path)
    content = f"{counted(exported.boxes, 'animal')} in {counted(exported.images, 'image')}"
    print(f"{content} written as {job.to}: {path}")
    return _print_losses(exported, faults)


def _print_losses(exported: ExportSummary, faults: Sequence[SampleError]) -> ExitCode:
    """Print what was lost, and what a careful person should know."""
    for note in exported.notes:
        print(f"warning: {note}", file=sys.stderr)
    for fault in (*faults, *exported.faults):
        print(f"  faulty: {fault}", file=sys.stderr)
    return ExitCode.FAULTY if faults or exported.faults else ExitCode.OK


def _refuse_options_of_cuboids(job: ExportJob, why: str) -> None:
    """Raise a ConfigError for an option that only cuboids have a use for."""
    _refuse_options(job)
    for name, value in (
        ("--images", job.images),
        ("--metres-per-unit", job.metres_per_unit),
        ("--scale-free", job.scale_free or None),
    ):
        if value is not None:
            raise ConfigError(f"{name} is for cuboids: {why}")


def _export_fits(job: ExportJob) -> ExitCode:
    """Write the parameters of fitted bodies, and say what has none."""
    _refuse_options_of_cuboids(job, "fits are written in their body's unit")
    if not is_labels(job.path):
        raise ConfigError(f"--to {job.to} writes the fits of labels, and {job.path} is none")
    if job.to == "quadruped" and job.model is not None:
        raise ConfigError("--model is for --to animal3d: fits of the quadruped need none")
    animals, faults, without = read_label_fits(job.path)
    if job.to == "quadruped":
        exported = write_quadruped(animals, _json_path(job, "fits.json"))
    elif job.model is None:
        check_fits_of_model(animals)
        raise ConfigError("--to animal3d needs --model, the SMAL model that was fitted")
    else:
        path = _json_path(job, "train.json")
        exported = write_animal3d_fits(animals, path, load_model(job.model))
    print(
        f"{counted(exported.boxes, 'fitted body', 'fitted bodies')} in"
        f" {counted(exported.images, 'image')} written as {job.to}:"
        f" {exported.files[0]}"
    )
    notes = [f"{without} animals have labels of other bodies, which are not written"]
    exported = replace(exported, notes=(*exported.notes, *(notes if without else ())))
    return _print_losses(exported, faults)


def read_cuboids(path: Path, options: CuboidOptions) -> CuboidSet:
    """The cuboids of a labels.json, of the folder that `label` wrote, or of a format of cuboids.

    Raises:
        ConfigError: options for labels, which say all themselves.
        DatasetNotFoundError: nothing there.
        DatasetFormatError: another file.

    """
    if is_labels(path):
        if options.images is not None:
            raise ConfigError(
                "--images is for files of cuboids, and of labels for --to kitti, which writes"
                " pictures: image paths of labels are written as they stand"
            )
        if options.metric != "info":
            raise ConfigError("--metric is for files of cuboids: labels say their scale")
        return read_label_cuboids(path)
    if cuboid_format(path) is not None:
        return read_cuboid_set(path, options)
    if path.is_dir():
        raise DatasetNotFoundError(
            f"{path} holds neither labels.json nor KITTI's label_2/; give the folder that"
            " animal3dbox label wrote, one of KITTI's, or a JSON"
        )
    raise DatasetFormatError(
        f"{path} is neither labels.json nor in Omni3D's format (images, categories, annotations)"
    )


def is_labels(path: Path) -> bool:
    """Whether a path is a labels.json, or a folder with one.

    Raises:
        DatasetNotFoundError: nothing there.
        DatasetFormatError: a .json file that is none.

    """
    keys = path_summary(path).keys
    return (
        labels_file(path).is_file()
        if path.is_dir()
        else keys is not None and "animals" in keys and "body" in keys
    )


def _written(cuboids: CuboidSet, job: ExportJob) -> ExportSummary:
    _refuse_options(job)
    if job.to == "kitti":
        if job.out.is_file():
            raise ConfigError(f"--out {job.out} is a file: KITTI is a folder")
        return write_kitti(
            cuboids,
            job.out,
            scale_free=job.scale_free,
            split=job.split or "train",
            first_id=job.first_id or 0,
        )
    path = _json_path(job, FILE_NAME)
    first_id = 1 if job.first_id is None else job.first_id
    if job.to == "oracle2d":
        return write_oracle2d(cuboids, path, first_id=first_id, categories=job.categories)
    if job.to == "coco":
        return write_coco(cuboids, path, first_id=first_id, categories=job.categories)
    return write_omni3d(
        cuboids,
        path,
        scale_free=job.scale_free,
        split=job.split or "train",
        dataset_id=job.dataset_id or 0,
        first_id=first_id,
        categories=job.categories,
    )


def _refuse_options(job: ExportJob) -> None:
    """Raise a ConfigError for an option that the format to write has no use for."""
    for name, value, formats in (
        ("--first-id", job.first_id, ("omni3d", "coco", "kitti", "oracle2d")),
        ("--dataset-id", job.dataset_id, ("omni3d",)),
        ("--split", job.split, ("omni3d", "kitti")),
        ("--categories", job.categories or None, ("omni3d", "coco", "oracle2d")),
    ):
        if value is not None and job.to not in formats:
            raise ConfigError(f"{name} is for --to {' or '.join(formats)}, not {job.to}")


def _json_path(job: ExportJob, name: str) -> Path:
    """The JSON file that --out names, or one of a name in that folder."""
    is_file = job.out.suffix.lower() == ".json" and not job.out.is_dir()
    return job.out if is_file else job.out / name
