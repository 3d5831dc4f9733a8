"""A whole project of DeepLabCut: config.yaml beside labeled-data/, a folder of pictures a video."""

from pathlib import Path

from animal3dbox.datasets.readers.deeplabcut.reader import FORMAT, label_files, read_deeplabcut
from animal3dbox.datasets.readers.distinct_animals import distinct_animals
from animal3dbox.datasets.readers.tolerance import Tolerance
from animal3dbox.datasets.records import AnimalRecord, RecordSet
from animal3dbox.errors import Animal3DBoxError, DatasetNotFoundError, SampleError
from animal3dbox.smal.keypoints.vocabulary import Vocabulary

CONFIG, VIDEOS = "config.yaml", "labeled-data"


def is_project(path: Path) -> bool:
    """Whether a folder is a project."""
    return (path / CONFIG).is_file() and (path / VIDEOS).is_dir()


def read_project(
    path: Path,
    images: Path | None = None,
    vocabulary: Vocabulary | None = None,
    tolerance: Tolerance | None = None,
    *,
    upright: bool = False,
) -> RecordSet:
    """The animals of all videos of a project; a table that cannot be read spoils no other.

    Args:
        path: the project's folder.
        images: the folder that the rows' paths are relative to; None: the project's.
        vocabulary: what the bodyparts are, if their names do not tell.
        tolerance: counts what is taken for missing; None: nobody asks.
        upright: without tolerance: whether pictures are turned as their headers say.

    Raises:
        DatasetNotFoundError: no video has a table.

    """
    tolerance = tolerance or Tolerance(upright=upright)
    videos = [video for video in sorted((path / VIDEOS).iterdir()) if video.is_dir()]
    tables = [table for video in videos for table in label_files(video)]
    faults = [fault for video in videos for fault in _without_table(video, path)]
    if not tables and not faults:
        raise DatasetNotFoundError(f"no folder of {path / VIDEOS} holds a table of DeepLabCut")
    records: list[AnimalRecord] = []
    table_of: dict[str, str] = {}
    notes: list[str] = []
    for table in tables:
        name = table.relative_to(path).as_posix()
        try:
            found = read_deeplabcut(table, images or path, vocabulary, tolerance)
        except Animal3DBoxError as error:
            faults.append(SampleError(name, "table", str(error)))
            continue
        faults += found.faults
        for record in found.records:
            first = table_of.setdefault(record.sample_id, name)
            if first == name:
                records.append(record)
                continue
            problem = f"is in {first}, too, and counts once: give it to one table alone"
            faults.append(SampleError(record.sample_id, name, problem))
        notes += [f"{name}: {note}" for note in found.notes]
    kept, same_files = distinct_animals(records, tolerance)
    return RecordSet(FORMAT, kept, (*faults, *same_files), (*notes, *tolerance.notes()))


def _without_table(video: Path, project: Path) -> list[SampleError]:
    """An error for each file of a video's folder that should be a table and is none."""
    known = {table.stem for table in label_files(video)}
    return [
        SampleError(
            file.relative_to(project).as_posix(),
            "table",
            "is no table of DeepLabCut: its first rows must be scorer, bodyparts and coords, in"
            " UTF-8, with commas, semicolons or tabs",
        )
        for file in sorted(video.iterdir())
        if file.suffix.lower() == ".csv" and file.stem not in known
    ]
