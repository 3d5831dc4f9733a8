"""The command `demo`: posed quadrupeds under known cameras, labelled, compared with the truth."""

import sys
from collections.abc import Sequence

import msgspec
import torch
from torch import Tensor

from animal3dbox.cli.demo_page import ComparedAnimal, compared_animal, write_demo_page
from animal3dbox.cli.exit_codes import ExitCode
from animal3dbox.cli.jobs import DemoJob
from animal3dbox.datasets.bodies.sources import model_mobility, standing_vertices
from animal3dbox.datasets.synthetic.annotation import annotate
from animal3dbox.datasets.synthetic.faults import FaultConfig, faulty
from animal3dbox.datasets.synthetic.scenes import SyntheticAnimal, synthetic_animal
from animal3dbox.errors import ConfigError
from animal3dbox.evaluate.config import METHODS
from animal3dbox.evaluate.files import Evaluation
from animal3dbox.evaluate.page import write_page
from animal3dbox.evaluate.tables import table_from_records
from animal3dbox.files import write_whole
from animal3dbox.geometry.camera import project
from animal3dbox.geometry.cuboid import FACE_NAMES
from animal3dbox.geometry.rigid_transforms import rotation_angle
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.label import label_animal
from animal3dbox.labels.types import CuboidLabel, Rejection
from animal3dbox.plurals import counted
from animal3dbox.progress import watched
from animal3dbox.report.run import make_results_folder, write_run
from animal3dbox.report.run_rows import Labelled
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES
from animal3dbox.smal.quadruped.preset_bodies import preset_betas


class Score(msgspec.Struct, kw_only=True):
    """How one label compares with the truth.

    Attributes:
        keypoint_px: mean distance of the projected landmarks from the clean keypoints.
        corner_percent: mean distance of the corners from the true ones, in % of the box diagonal,
            camera frame.
        axes_deg: angle between the box's axes and the true trunk's, camera frame.
        side: the side with the largest share is the true one.
    """

    keypoint_px: float
    corner_percent: float
    axes_deg: float
    side: bool


class MethodResult(msgspec.Struct, kw_only=True):
    """One method over all animals: medians and 95th percentiles over those it labelled."""

    method: str
    labelled: int
    animals: int
    keypoint_px_median: float | None
    keypoint_px_p95: float | None
    corner_percent_median: float | None
    corner_percent_p95: float | None
    axes_deg_median: float | None
    axes_deg_p95: float | None
    sides_right: int


def score(label: CuboidLabel, animal: SyntheticAnimal, landmarks: Tensor) -> Score:
    """Compare a label, made with these landmarks (J, 3) of its body, with the truth."""
    in_frame = animal.keypoints_2d[:, 2] > 0
    keypoints_px = animal.keypoints_2d[in_frame, :2]
    projected_px, _ = project(label.K, landmarks[in_frame] @ label.R.mT + label.t)
    corner_offsets = label.corners_3d - animal.cuboid.corners()
    corner_error = torch.linalg.vector_norm(corner_offsets, dim=-1).mean()
    return Score(
        keypoint_px=float(torch.linalg.vector_norm(projected_px - keypoints_px, dim=-1).mean()),
        corner_percent=100 * float(corner_error / animal.cuboid.diagonal),
        axes_deg=float(torch.rad2deg(rotation_angle(label.rotation, animal.cuboid.rotation))),
        side=label.side == FACE_NAMES[int(animal.faces_seen.share.argmax())],
    )


def label_synthetic(
    animal: SyntheticAnimal, keypoints: Tensor, config: LabelConfig, rigid: bool = False
) -> CuboidLabel | Rejection:
    """Label a synthetic animal from keypoints, its mask and its intrinsics.

    The camera pose is not given.

    Args:
        animal: with its image, mask and true body.
        keypoints: (26, 3) x, y, visibility.
        config: how the label is made.
        rigid: with the standing species, as for photographs, instead of the true body.

    """
    sigma = None
    if rigid:
        betas = tuple(preset_betas(animal.preset).tolist())
        sigma = model_mobility(animal.model, betas, VOCABULARIES["animal3d26"])
    return label_animal(
        image_hw=animal.image_hw,
        keypoints_2d=keypoints,
        vertices=_body_vertices(animal, rigid),
        faces=animal.model.faces,
        template=animal.model,
        K=animal.K,
        mask=animal.mask,
        sample_id=animal.sample_id,
        config=config,
        landmark_sigma=sigma,
    )


def _body_vertices(animal: SyntheticAnimal, rigid: bool) -> Tensor:
    """The true body's vertices (V, 3), or those of its species, standing."""
    if not rigid:
        return animal.vertices
    return standing_vertices(animal.model, tuple(preset_betas(animal.preset).tolist()))


def run_demo(job: DemoJob) -> ExitCode:
    """Render animals, label them by every method, and compare the labels with the truth."""
    if job.n < 1 or not job.noise_px >= 0 or not 0 <= job.outliers <= 1:
        raise ConfigError(
            f"--n must be at least 1, --noise-px not negative, --outliers from 0 to 1; got {job.n},"
            f" {job.noise_px} and {job.outliers}"
        )
    make_results_folder(job.out)
    faults = FaultConfig(noise_px=job.noise_px, outliers=job.outliers)
    torch.set_num_threads(1)  # many small problems: more threads would only wait for each other
    scores: dict[str, list[Score]] = {method: [] for method in METHODS}
    results: list[Labelled] = []
    compared: list[ComparedAnimal] = []
    for index in watched(range(job.n), "drawing and labelling", unit="animal"):
        animal = synthetic_animal(job.seed, index)
        keypoints = faulty(annotate(animal, hidden="marked"), faults, job.seed).keypoints_2d
        landmarks = VOCABULARIES["animal3d26"].on_body(
            animal.model.landmarks, _body_vertices(animal, job.rigid)
        )
        for method, config in METHODS.items():
            outcome = label_synthetic(animal, keypoints, config, job.rigid)
            if isinstance(outcome, CuboidLabel):
                scores[method].append(score(outcome, animal, landmarks))
            if method == "default":
                picture = animal.image.numpy()
                results.append(Labelled(outcome, animal.sample_id, animal.preset, picture))
                compared.append(compared_animal(animal, outcome))
    summaries = [_result(method, of_method, job.n) for method, of_method in scores.items()]
    _write(job, results, summaries)
    write_demo_page(job.out / "index.html", compared, _about(job))
    _print(summaries, job)
    return ExitCode.OK


def _write(job: DemoJob, results: Sequence[Labelled], summaries: Sequence[MethodResult]) -> None:
    """The label files and pictures of our method, and how every method compares."""
    write_run(
        job.out,
        results,
        source=f"{counted(job.n, 'synthetic animal')}, seed {job.seed}, {_faults(job)}",
        body=_body(job),
        config=METHODS["default"],
    )
    write_whole(
        job.out / "demo.json", msgspec.json.format(msgspec.json.encode(summaries), indent=1)
    )
    records = [msgspec.structs.asdict(one) for one in summaries]
    notes = (
        "keypoint_px: distance of projected landmarks from the clean keypoints; corner_percent: of"
        " the corners from the true ones, in % of the box's diagonal; axes_deg: between the box's"
        " axes and the trunk's. Median and 95th percentile over the animals.",
    )
    table = table_from_records("methods", "Every method against the truth", records, notes=notes)
    evaluation = Evaluation(
        f"{counted(job.n, 'synthetic animal')}, seed {job.seed}",
        {"keypoints": _faults(job), "body": _body(job)},
        (table,),
    )
    write_page(job.out / "evaluation.html", evaluation, {})


def _faults(job: DemoJob) -> str:
    return f"{job.noise_px:g} px noise, {job.outliers:.0%} outliers"


def _body(job: DemoJob) -> str:
    return "quadruped, standing" if job.rigid else "quadruped, true shape and pose"


def _about(job: DemoJob) -> str:
    return f"Seed {job.seed}; keypoints with {_faults(job)}; body: {_body(job)}"


def _result(method: str, scores: list[Score], n: int) -> MethodResult:
    """Medians and 95th percentiles of a method's scores, of n animals."""

    def quantile(values: list[float], q: float) -> float | None:
        return float(torch.tensor(values, dtype=torch.float64).quantile(q)) if values else None

    px, corners, axes = (
        [getattr(s, field) for s in scores]
        for field in ("keypoint_px", "corner_percent", "axes_deg")
    )
    return MethodResult(
        method=method,
        labelled=len(scores),
        animals=n,
        keypoint_px_median=quantile(px, 0.5),
        keypoint_px_p95=quantile(px, 0.95),
        corner_percent_median=quantile(corners, 0.5),
        corner_percent_p95=quantile(corners, 0.95),
        axes_deg_median=quantile(axes, 0.5),
        axes_deg_p95=quantile(axes, 0.95),
        sides_right=sum(s.side for s in scores),
    )


def _print(results: list[MethodResult], job: DemoJob) -> None:
    if job.json:
        sys.stdout.write(msgspec.json.encode(results).decode() + "\n")
        return
    print(f"body: {'the species, standing' if job.rigid else 'true shape and pose'}")
    print(
        f"keypoints with {job.noise_px:g} px noise, {job.outliers:.0%} outliers; errors are median"
        " / 95th percentile against the truth"
    )
    print(
        f"{'method':16} {'labelled':>9} {'keypoints px':>14} {'corners % diag':>15}"
        f" {'axes deg':>14} {'right side':>11}"
    )
    for r in results:
        pairs = [
            (r.keypoint_px_median, r.keypoint_px_p95),
            (r.corner_percent_median, r.corner_percent_p95),
            (r.axes_deg_median, r.axes_deg_p95),
        ]
        cells = ["-" if a is None or b is None else f"{a:.2f} / {b:.2f}" for a, b in pairs]
        print(
            f"{r.method:16} {r.labelled:>5}/{r.animals:<3} {cells[0]:>14} {cells[1]:>15}"
            f" {cells[2]:>14} {r.sides_right:>7}/{r.labelled}"
        )
    print(f"look at {job.out / 'index.html'}")
