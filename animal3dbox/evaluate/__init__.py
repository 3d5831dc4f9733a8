"""The paper's evaluation as protocols on a world of known truth, and what of it a dataset allows.

The names below are loaded when first used (PEP 562).
"""

from typing import TYPE_CHECKING

from animal3dbox.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from animal3dbox.evaluate.accuracy import AccuracyRow as AccuracyRow
    from animal3dbox.evaluate.comparison import ComparedBox as ComparedBox
    from animal3dbox.evaluate.comparison import compared_boxes as compared_boxes
    from animal3dbox.evaluate.comparison import comparison_tables as comparison_tables
    from animal3dbox.evaluate.comparison_metrics import metrics_table as metrics_table
    from animal3dbox.evaluate.config import METHODS as METHODS
    from animal3dbox.evaluate.config import EvaluateConfig as EvaluateConfig
    from animal3dbox.evaluate.dataset_study import DatasetRow as DatasetRow
    from animal3dbox.evaluate.dataset_study import dataset_rows as dataset_rows
    from animal3dbox.evaluate.dataset_study import dataset_table as dataset_table
    from animal3dbox.evaluate.dataset_study import true_boxes as true_boxes
    from animal3dbox.evaluate.face_study import FaceRow as FaceRow
    from animal3dbox.evaluate.files import Evaluation as Evaluation
    from animal3dbox.evaluate.files import as_text as as_text
    from animal3dbox.evaluate.files import write_json as write_json
    from animal3dbox.evaluate.orientation import StabilityRow as StabilityRow
    from animal3dbox.evaluate.page import write_page as write_page
    from animal3dbox.evaluate.pose_study import PoseRow as PoseRow
    from animal3dbox.evaluate.reproduction import ReproductionRow as ReproductionRow
    from animal3dbox.evaluate.run import StudyRows as StudyRows
    from animal3dbox.evaluate.run import evaluate_world as evaluate_world
    from animal3dbox.evaluate.run import world_tables as world_tables
    from animal3dbox.evaluate.tables import Table as Table

__getattr__, __dir__, __all__ = lazy_exports(
    __name__,
    {
        "accuracy": ("AccuracyRow",),
        "comparison": ("ComparedBox", "compared_boxes", "comparison_tables"),
        "comparison_metrics": ("metrics_table",),
        "config": ("METHODS", "EvaluateConfig"),
        "dataset_study": ("DatasetRow", "dataset_rows", "dataset_table", "true_boxes"),
        "face_study": ("FaceRow",),
        "files": ("Evaluation", "as_text", "write_json"),
        "orientation": ("StabilityRow",),
        "page": ("write_page",),
        "pose_study": ("PoseRow",),
        "reproduction": ("ReproductionRow",),
        "run": ("StudyRows", "evaluate_world", "world_tables"),
        "tables": ("Table",),
    },
)
