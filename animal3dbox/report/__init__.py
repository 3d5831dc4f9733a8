"""What users read and look at: labels.json and labels.csv, overlays, the gallery, the counts.

The names below are loaded when first used (PEP 562).

Example:
    A label goes into labels.json and comes back as the row of a schema:

    >>> import tempfile
    >>> from pathlib import Path
    >>> from animal3dbox import LabelConfig, label_animal
    >>> from animal3dbox.report import LabelFile, animal_row, read_labels_json, write_labels_json
    >>> label = label_animal(
    ...     image_hw=(120, 160),
    ...     vertices=[[x, y, z] for x in (-1, 1) for y in (-0.5, 0.5) for z in (-0.4, 0.4)],
    ...     K=[[100, 0, 79.5], [0, 100, 59.5], [0, 0, 1]],
    ...     pose=([[1, 0, 0], [0, 0, -1], [0, 1, 0]], [0, 0, 5]),
    ...     config=LabelConfig(axes="pca"),
    ... )
    >>> row = animal_row(label, image="herd/a.jpg", animal=0, category="dog")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder) / "labels.json"
    ...     write_labels_json(file, LabelFile(body="dog", config={}, animals=[row], rejected=[]))
    ...     read_labels_json(file).animals[0].side
    'right'
"""

from typing import TYPE_CHECKING

from animal3dbox.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from animal3dbox.report.ecology.camtrap_observations import write_camtrap_dp as write_camtrap_dp
    from animal3dbox.report.ecology.wbia import write_wbia as write_wbia
    from animal3dbox.report.ecology.wildlife_datasets import (
        write_wildlife_datasets as write_wildlife_datasets,
    )
    from animal3dbox.report.gallery import Card as Card
    from animal3dbox.report.gallery import write_gallery as write_gallery
    from animal3dbox.report.label_cuboids import read_label_cuboids as read_label_cuboids
    from animal3dbox.report.label_files import AnimalRow as AnimalRow
    from animal3dbox.report.label_files import FitRow as FitRow
    from animal3dbox.report.label_files import LabelFile as LabelFile
    from animal3dbox.report.label_files import RejectedRow as RejectedRow
    from animal3dbox.report.label_files import animal_row as animal_row
    from animal3dbox.report.label_files import write_labels_json as write_labels_json
    from animal3dbox.report.label_fits import read_label_fits as read_label_fits
    from animal3dbox.report.label_reading import read_label_rows as read_label_rows
    from animal3dbox.report.label_reading import read_labels_json as read_labels_json
    from animal3dbox.report.label_targets import target_of_row as target_of_row
    from animal3dbox.report.labels_csv import write_labels_csv as write_labels_csv
    from animal3dbox.report.overlay import draw_cuboid as draw_cuboid
    from animal3dbox.report.overlay import draw_label as draw_label
    from animal3dbox.report.prediction_overlay import draw_predictions as draw_predictions
    from animal3dbox.report.rerun_view import write_rerun as write_rerun
    from animal3dbox.report.run import write_run as write_run
    from animal3dbox.report.run_rows import Labelled as Labelled
    from animal3dbox.report.summary import FLAGS as FLAGS
    from animal3dbox.report.summary import Summary as Summary
    from animal3dbox.report.summary import flags_of as flags_of
    from animal3dbox.report.table.keys import missing_indices as missing_indices
    from animal3dbox.report.table.label_table import label_table as label_table
    from animal3dbox.report.table.part_writer import PartWriter as PartWriter
    from animal3dbox.report.table.parts import write_part as write_part
    from animal3dbox.report.table.plan import table_plan as table_plan
    from animal3dbox.report.table.table_gallery import write_table_gallery as write_table_gallery

__getattr__, __dir__, __all__ = lazy_exports(
    __name__,
    {
        "ecology.camtrap_observations": ("write_camtrap_dp",),
        "ecology.wbia": ("write_wbia",),
        "ecology.wildlife_datasets": ("write_wildlife_datasets",),
        "gallery": ("Card", "write_gallery"),
        "label_cuboids": ("read_label_cuboids",),
        "label_files": (
            "AnimalRow",
            "FitRow",
            "LabelFile",
            "RejectedRow",
            "animal_row",
            "write_labels_json",
        ),
        "label_fits": ("read_label_fits",),
        "labels_csv": ("write_labels_csv",),
        "label_reading": ("read_label_rows", "read_labels_json"),
        "label_targets": ("target_of_row",),
        "overlay": ("draw_cuboid", "draw_label"),
        "prediction_overlay": ("draw_predictions",),
        "rerun_view": ("write_rerun",),
        "run": ("write_run",),
        "run_rows": ("Labelled",),
        "summary": ("FLAGS", "Summary", "flags_of"),
        "table.keys": ("missing_indices",),
        "table.label_table": ("label_table",),
        "table.part_writer": ("PartWriter",),
        "table.parts": ("write_part",),
        "table.plan": ("table_plan",),
        "table.table_gallery": ("write_table_gallery",),
    },
)
