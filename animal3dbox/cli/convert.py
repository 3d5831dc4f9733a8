"""The command `convert-model`: a SMAL pickle as safetensors, which cannot hold code."""

import sys
from pathlib import Path

from animal3dbox.cli.exit_codes import ExitCode
from animal3dbox.cli.setup_jobs import ConvertModelJob
from animal3dbox.datasets.bodies.mesh_file import landmark_ids
from animal3dbox.errors import ConfigError
from animal3dbox.smal.files.model_files import SAFETENSORS_SUFFIX, load_model
from animal3dbox.smal.files.safetensors_file import save_safetensors
from animal3dbox.smal.keypoints.smal_topology import misplaced_sides


def run_convert(job: ConvertModelJob) -> ExitCode:
    """Convert the model that a job names."""
    return convert_model(job.source, job.target, job.landmarks)


def convert_model(source: Path, target: Path, landmarks: Path | None = None) -> ExitCode:
    """Write the body model of one file into another and say in a line what it is.

    Args:
        source: the model's file.
        target: the .safetensors file.
        landmarks: JSON with the vertices of a pickle's landmarks, where its mesh is not SMAL's.

    Raises:
        ConfigError: a file has a suffix that is not known (2).
        ModelFileError: the source is refused (3).
        OSError: the target cannot be written (5).

    """
    if target.suffix.lower() != SAFETENSORS_SUFFIX:
        raise ConfigError(f"the target must end in {SAFETENSORS_SUFFIX}, got {target}")
    model = load_model(source, None if landmarks is None else landmark_ids(landmarks))
    save_safetensors(model, target)
    parts = {"vertices": model.vertex_count, "faces": len(model.faces), "joints": model.joint_count}
    parts |= {"betas": model.beta_count, "landmarks": len(model.landmarks)}
    counts = ", ".join(f"{count} {name}" for name, count in parts.items())
    print(f"{source} -> {target}: {counts}, {target.stat().st_size / 1e6:.1f} MB")
    misplaced = misplaced_sides(model.v_template, model.landmarks)
    if misplaced:
        print(
            f"animal3dbox: warning: {', '.join(misplaced)} lie on the animal's other side: are"
            " these SMAL's vertices?",
            file=sys.stderr,
        )
    return ExitCode.OK
