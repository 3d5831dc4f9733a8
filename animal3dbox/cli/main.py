"""The command line.

``animal3dbox demo``, ``label``, ``synth``, ``evaluate``, ``inspect``, ``export``, ``check`` and
``convert-model``.

Nothing heavy is imported until a command runs, so that ``--help`` answers at once.

Exit codes: 0 all samples were read (each animal has a label or a reason in report.json); 2 wrong
usage; 3 the input cannot be found or read as a whole; 4 done, but some samples were faulty and are
listed in report.json; 5 the results could not be written.
"""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Literal

import tyro

from animal3dbox.errors import (
    Animal3DBoxError,
    ConfigError,
    DatasetFormatError,
    DatasetNotFoundError,
)

EXIT_USAGE, EXIT_INPUT, EXIT_OUTPUT = 2, 3, 5

Format = Literal["auto", "animal3d", "mesh_folder", "coco", "deeplabcut", "stanfordextra"]
"""The formats of datasets.formats; a test compares them."""


def demo(
    out: Annotated[Path, tyro.conf.arg(help="folder for the results")] = Path("demo-output"),
    n: Annotated[int, tyro.conf.arg(help="animals")] = 12,
    seed: Annotated[int, tyro.conf.arg(help="another seed gives other animals")] = 0,
    noise_px: Annotated[
        float, tyro.conf.arg(help="standard deviation of the keypoints' noise")
    ] = 2.0,
    outliers: Annotated[
        float, tyro.conf.arg(help="part of the keypoints, 0 to 1, that lie anywhere in the image")
    ] = 0.0,
    rigid: Annotated[
        bool,
        tyro.conf.arg(
            help="label with the standing species, as for photographs, not with the true pose"
        ),
    ] = False,
    json: Annotated[bool, tyro.conf.arg(help="print the result as JSON")] = False,
) -> int:
    """Render posed quadrupeds, label them from noisy keypoints, and compare with the truth."""
    from animal3dbox.cli.demo import DemoJob, run_demo

    return run_demo(DemoJob(out, n, seed, noise_px, outliers, rigid, json))


def label(
    path: Annotated[
        tyro.conf.Positional[Path],
        tyro.conf.arg(metavar="PATH", help="a dataset's folder or its annotation file"),
    ],
    out: Annotated[
        Path | None,
        tyro.conf.arg(
            help="folder for labels.json, labels.csv, overlays, gallery.html and report.json"
        ),
    ] = None,
    format: Annotated[Format, tyro.conf.arg(help="the annotations' format")] = "auto",
    images: Annotated[
        Path | None, tyro.conf.arg(help="folder that the annotations' image paths are relative to")
    ] = None,
    model: Annotated[
        Path | None,
        tyro.conf.arg(
            help="the SMAL model (.pkl, .safetensors) of the dataset's own parameters or meshes"
        ),
    ] = None,
    body: Annotated[
        str | None,
        tyro.conf.arg(
            help=(
                "one body for all: a preset of the quadruped (dog, cat, ...), a SMAL model or a"
                " mesh file; without --model, dog"
            )
        ),
    ] = None,
    landmarks: Annotated[
        Path | None, tyro.conf.arg(help="JSON with the mesh file's landmarks (docs/formats.md)")
    ] = None,
    vocabulary: Annotated[
        str | None,
        tyro.conf.arg(
            help=(
                "what the keypoints are if their names do not tell (COCO): a vocabulary's name or a"
                " TOML file"
            )
        ),
    ] = None,
    method: Annotated[
        Literal["default", "paper", "basic"],
        tyro.conf.arg(help="camera pose: ours, the paper's, its baseline"),
    ] = "default",
    axes: Annotated[
        Literal["default", "landmarks", "pca"],
        tyro.conf.arg(help="body axes: ours, the paper's, its baseline"),
    ] = "default",
    residual: Annotated[
        Literal["vector", "literal"],
        tyro.conf.arg(help="how the paper's E_total is read (method paper)"),
    ] = "vector",
    tail: Annotated[
        Literal["keep", "drop"],
        tyro.conf.arg(help="whether the boxes hold the tail; the same for all animals"),
    ] = "keep",
    min_keypoints: Annotated[int, tyro.conf.arg(help="fewest visible keypoints")] = 6,
    focal_px: Annotated[
        float | None,
        tyro.conf.arg(
            help=(
                "focal length of the images without a camera of their own; else the dataset's,"
                " EXIF's or a guess"
            )
        ),
    ] = None,
    metres_per_unit: Annotated[
        float | None, tyro.conf.arg(help="metres in a unit of the bodies, to make labels metric")
    ] = None,
    species_scale: Annotated[
        bool,
        tyro.conf.arg(help="make labels metric by typical lengths of species (docs/formats.md)"),
    ] = False,
    altitude_m: Annotated[
        float | None,
        tyro.conf.arg(help="make labels metric by the height of a camera that looks straight down"),
    ] = None,
    stored_pose: Annotated[
        Literal["hypothesis", "exact"],
        tyro.conf.arg(
            help="take the camera that the dataset stores for its bodies as a guess, or as known"
        ),
    ] = "hypothesis",
    cache: Annotated[
        Path | None,
        tyro.conf.arg(
            help=(
                "fill this label cache of a Dataset with the same options, instead of writing to"
                " --out"
            )
        ),
    ] = None,
    shard: Annotated[
        str | None,
        tyro.conf.arg(help="with --cache: i/n, only the images i, i + n, ... counted from 1"),
    ] = None,
    resume: Annotated[
        bool, tyro.conf.arg(help="with --cache: keep the labels that are in it")
    ] = False,
    workers: Annotated[int, tyro.conf.arg(help="with --cache: processes")] = 0,
    mask_iou: Annotated[
        bool,
        tyro.conf.arg(
            help=(
                "with --cache and --stored-pose exact: measure the masks' overlap too, as a Dataset"
                " does whose filters ask for it"
            )
        ),
    ] = False,
    json: Annotated[
        bool, tyro.conf.arg(help="print report.json instead of words; no progress bar")
    ] = False,
) -> int:
    """Label the animals of a dataset: cuboids with named faces, tables, pictures and a gallery."""
    from animal3dbox.cli.fill import run_fill
    from animal3dbox.cli.label import LabelJob, run_label, scale_of
    from animal3dbox.labels.config import LabelConfig

    config = LabelConfig(
        method=method, axes=axes, residual=residual, tail=tail, min_keypoints=min_keypoints
    )
    scale = scale_of(metres_per_unit, species_scale, altitude_m)
    job = LabelJob(
        path, out, format, images, model, body, landmarks, vocabulary, config, json, scale, stored_pose, cache, shard, resume, workers, mask_iou,
        focal_px,
    )  # fmt: skip
    return run_label(job) if cache is None else run_fill(job)


def synth(
    out: Annotated[Path, tyro.conf.arg(help="folder for the dataset")],
    n: Annotated[int, tyro.conf.arg(help="images")] = 100,
    seed: Annotated[int, tyro.conf.arg(help="another seed gives another world")] = 0,
    format: Annotated[
        Literal["animal3d", "stanfordextra"], tyro.conf.arg(help="the files' format")
    ] = "animal3d",
    model: Annotated[
        Path | None,
        tyro.conf.arg(
            help="where to write Animal3D's SMAL pickle; default: beside the folder, OUT-model.pkl"
        ),
    ] = None,
    width: Annotated[int, tyro.conf.arg(help="of the images, px")] = 640,
    height: Annotated[int, tyro.conf.arg(help="of the images, px")] = 480,
    mark_hidden: Annotated[
        bool, tyro.conf.arg(help="mark keypoints in the frame that something hides, too")
    ] = False,
    noise_px: Annotated[
        float, tyro.conf.arg(help="standard deviation of the keypoints' noise")
    ] = 0.0,
    outliers: Annotated[
        float, tyro.conf.arg(help="part of the keypoints that lie anywhere in the image")
    ] = 0.0,
    missing: Annotated[
        float, tyro.conf.arg(help="part of the keypoints that are not marked")
    ] = 0.0,
    zeros: Annotated[
        float, tyro.conf.arg(help="part of the keypoints left at (0, 0) but marked")
    ] = 0.0,
    wrong_flags: Annotated[
        float, tyro.conf.arg(help="part of the keypoints whose visibility is the opposite")
    ] = 0.0,
    swap: Annotated[
        Literal["none", "all", "legs", "fore", "hind", "head"],
        tyro.conf.arg(help="exchange left and right of these"),
    ] = "none",
    swapped: Annotated[
        float, tyro.conf.arg(help="part of the animals to which that happens")
    ] = 1.0,
    focal_factor: Annotated[float, tyro.conf.arg(help="focal length told, by the true one")] = 1.0,
    joint_deg: Annotated[
        float,
        tyro.conf.arg(help="standard deviation of the fitted joints' angles from the true ones"),
    ] = 0.0,
    body_scale: Annotated[
        float, tyro.conf.arg(help="size of the fitted body, by the true one")
    ] = 1.0,
    mask_px: Annotated[
        int, tyro.conf.arg(help="grow the masks by so many px, or shrink them if negative")
    ] = 0,
) -> int:
    """Write a synthetic dataset.

    Pictures of posed quadrupeds, annotations with faults by a dial, and the truth.
    """
    from animal3dbox.cli.synth import SynthJob, run_synth
    from animal3dbox.datasets.synthetic.faults import FaultConfig

    faults = FaultConfig(
        noise_px=noise_px,
        outliers=outliers,
        missing=missing,
        zeros=zeros,
        wrong_flags=wrong_flags,
        swap=swap,
        swapped=swapped,
        focal_factor=focal_factor,
        joint_deg=joint_deg,
        body_scale=body_scale,
        mask_px=mask_px,
    )
    return run_synth(SynthJob(out, n, seed, format, model, (height, width), mark_hidden, faults))


def evaluate(
    path: Annotated[
        tyro.conf.Positional[Path | None],
        tyro.conf.arg(
            metavar="[PATH]", help="a dataset's folder or annotation file; without: our world"
        ),
    ] = None,
    out: Annotated[Path, tyro.conf.arg(help="folder for evaluation.json, .txt and .html")] = Path(
        "evaluation"
    ),
    n: Annotated[int, tyro.conf.arg(help="animals of our world")] = 500,
    seed: Annotated[int, tyro.conf.arg(help="another seed gives another world")] = 0,
    workers: Annotated[int, tyro.conf.arg(help="processes; the results are the same")] = 2,
    format: Annotated[Format, tyro.conf.arg(help="the annotations' format")] = "auto",
    images: Annotated[
        Path | None, tyro.conf.arg(help="folder that the annotations' image paths are relative to")
    ] = None,
    model: Annotated[
        Path | None, tyro.conf.arg(help="the SMAL model of the dataset's own parameters (Animal3D)")
    ] = None,
    body: Annotated[
        str | None,
        tyro.conf.arg(
            help="one body for all: a preset, a SMAL model or a mesh file; without --model, dog"
        ),
    ] = None,
    landmarks: Annotated[
        Path | None, tyro.conf.arg(help="JSON with the mesh file's landmarks (docs/formats.md)")
    ] = None,
    pictures: Annotated[
        bool, tyro.conf.arg(help="draw the paper's figures of our world too (extra plots)")
    ] = True,
) -> int:
    """Repeat the paper's evaluation on a world whose truth is known, or what of it a dataset
    allows."""
    from animal3dbox.cli.evaluate import EvaluateJob, run_evaluate

    return run_evaluate(
        EvaluateJob(path, out, n, seed, workers, format, images, model, body, landmarks, pictures)
    )


def export(
    path: Annotated[
        tyro.conf.Positional[Path],
        tyro.conf.arg(
            metavar="PATH",
            help="labels.json, the folder that label wrote, or a JSON in Omni3D's format",
        ),
    ],
    to: Annotated[Literal["omni3d", "coco", "kitti"], tyro.conf.arg(help="the format to write")],
    out: Annotated[Path, tyro.conf.arg(help="folder, or for omni3d and coco a .json file")],
    images: Annotated[
        Path | None, tyro.conf.arg(help="folder that an Omni3D file's image paths are relative to")
    ] = None,
    metres_per_unit: Annotated[
        float | None, tyro.conf.arg(help="scale of the boxes whose scale is not known")
    ] = None,
    scale_free: Annotated[
        bool, tyro.conf.arg(help="write lengths of unknown scale as they are")
    ] = False,
) -> int:
    """Write cuboids for other tools: Omni3D json, COCO keypoints or KITTI text files."""
    from animal3dbox.cli.export import ExportJob, run_export

    return run_export(ExportJob(path, to, out, images, metres_per_unit, scale_free))


def check(
    path: Annotated[
        tyro.conf.Positional[Path],
        tyro.conf.arg(
            metavar="PATH",
            help=(
                "labels.json, the folder that label wrote, a JSON in Omni3D's format, or a dataset,"
                " which is labelled"
            ),
        ),
    ],
    images: Annotated[
        Path | None, tyro.conf.arg(help="folder that the file's image paths are relative to")
    ] = None,
    format: Annotated[Format, tyro.conf.arg(help="of a dataset: the annotations' format")] = "auto",
    model: Annotated[
        Path | None,
        tyro.conf.arg(help="of a dataset: the SMAL model of its own parameters or meshes"),
    ] = None,
    body: Annotated[
        str | None,
        tyro.conf.arg(help="of a dataset: one body for all, a preset's name or a model's file"),
    ] = None,
    vocabulary: Annotated[
        str | None,
        tyro.conf.arg(help="of a dataset: what the keypoints are if their names do not tell"),
    ] = None,
    stored_pose: Annotated[
        Literal["hypothesis", "exact"],
        tyro.conf.arg(help="of a dataset: take its stored camera as a guess or as known"),
    ] = "hypothesis",
    cache: Annotated[Path | None, tyro.conf.arg(help="of a dataset: its label cache")] = None,
    workers: Annotated[int, tyro.conf.arg(help="of a dataset: processes")] = 0,
    json: Annotated[bool, tyro.conf.arg(help="print everything that is wrong as JSON")] = False,
) -> int:
    """Check labels.

    Cuboids against their corners, projections, faces, boxes and cameras, as training loops do.
    """
    from animal3dbox.cli.check import CheckJob, run_check

    return run_check(
        CheckJob(path, images, json, format, model, body, vocabulary, stored_pose, cache, workers)
    )


def inspect(
    path: Annotated[
        tyro.conf.Positional[Path],
        tyro.conf.arg(metavar="PATH", help="a dataset's folder or its annotation file"),
    ],
    format: Annotated[Format, tyro.conf.arg(help="the annotations' format")] = "auto",
    images: Annotated[
        Path | None, tyro.conf.arg(help="folder that the annotations' image paths are relative to")
    ] = None,
    model: Annotated[
        Path | None,
        tyro.conf.arg(
            help="the SMAL model of the dataset's own parameters or meshes: tells the most"
        ),
    ] = None,
    vocabulary: Annotated[
        str | None, tyro.conf.arg(help="what the keypoints are if their names do not tell")
    ] = None,
    json: Annotated[
        bool, tyro.conf.arg(help="print JSON (docs/formats.md) instead of words")
    ] = False,
) -> int:
    """Say what is in a copy of a dataset: counts, keys, masks, cameras and frames, sides, faults.

    Changes nothing.
    """
    from animal3dbox.cli.inspect import InspectJob, run_inspect

    return run_inspect(InspectJob(path, format, images, model, vocabulary, json))


def convert_model(
    source: Annotated[
        tyro.conf.Positional[Path],
        tyro.conf.arg(metavar="IN", help="a SMAL model, .pkl or .safetensors"),
    ],
    target: Annotated[
        tyro.conf.Positional[Path],
        tyro.conf.arg(metavar="OUT", help="the .safetensors file to write"),
    ],
) -> int:
    """Convert a SMAL pickle to safetensors, without running anything the pickle names."""
    from animal3dbox.cli.convert import convert_model as convert

    return convert(source, target)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command and exit with its code."""
    commands: dict[str, Callable[..., int]] = {
        "demo": demo,
        "label": label,
        "synth": synth,
        "evaluate": evaluate,
        "export": export,
        "check": check,
        "inspect": inspect,
        "convert-model": convert_model,
    }
    about = "3D boxes with named faces for animals."
    try:
        code = tyro.extras.subcommand_cli_from_dict(
            commands, prog="animal3dbox", description=about, args=arguments
        )
    except ConfigError as error:
        code = _complain(error, EXIT_USAGE)
    except (DatasetNotFoundError, DatasetFormatError) as error:
        code = _complain(error, EXIT_INPUT)
    except Animal3DBoxError as error:
        code = _complain(error, EXIT_INPUT)
    except OSError as error:  # a full disk, a folder that may not be written
        code = _complain(error, EXIT_OUTPUT)
    sys.exit(code)


def _complain(error: Exception, code: int) -> int:
    print(f"animal3dbox: {error}", file=sys.stderr)
    return code


if __name__ == "__main__":
    main()
