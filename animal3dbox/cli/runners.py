"""What each command does. Its module is imported when it runs: `--help` must not wait for torch."""

from animal3dbox.cli.exit_codes import ExitCode
from animal3dbox.cli.jobs import (
    CalibrateJob,
    CheckJob,
    ConvertModelJob,
    DemoJob,
    EvaluateJob,
    ExportJob,
    InspectJob,
    Job,
    LabelJob,
    SynthJob,
)


def run_job(job: Job) -> ExitCode:
    """Do what a job's options ask for; the exit code says how it ended.

    Raises:
        ConfigError: options that cannot be.
        Animal3DBoxError: input that cannot be used.
        OSError: output that cannot be written.

    """
    match job:
        case LabelJob():
            return _label(job)
        case DemoJob():
            from animal3dbox.cli.demo import run_demo

            return run_demo(job)
        case SynthJob():
            from animal3dbox.cli.synth import run_synth

            return run_synth(job)
        case EvaluateJob():
            from animal3dbox.cli.evaluate import run_evaluate

            return run_evaluate(job)
        case ExportJob():
            from animal3dbox.cli.export import run_export

            return run_export(job)
        case CheckJob():
            from animal3dbox.cli.check import run_check

            return run_check(job)
        case InspectJob():
            from animal3dbox.cli.inspect import run_inspect

            return run_inspect(job)
        case ConvertModelJob():
            from animal3dbox.cli.convert import convert_model

            return convert_model(job.source, job.target, job.landmarks)
        case CalibrateJob():
            from animal3dbox.cli.calibrate import run_calibrate

            return run_calibrate(job)


def _label(job: LabelJob) -> ExitCode:
    """Write labels and pictures, or fill a cache."""
    from animal3dbox.cli.fill import run_fill
    from animal3dbox.cli.label import run_label

    _ = job.config, job.scale_source  # made now, so that what they refuse is told at once
    return run_label(job) if job.cache.folder is None else run_fill(job)
