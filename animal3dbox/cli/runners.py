"""What each command does. Its module is imported when it runs: `--help` must not wait for torch."""

from collections.abc import Callable, Mapping
from importlib import import_module

from animal3dbox.cli import jobs
from animal3dbox.cli.bench_jobs import BenchJob
from animal3dbox.cli.exit_codes import ExitCode
from animal3dbox.cli.setup_jobs import ConvertModelJob, DoctorJob, VocabulariesJob

RUNNERS: Mapping[type, tuple[str, str]] = {
    jobs.DemoJob: ("demo", "run_demo"),
    jobs.LabelJob: ("label", "run_label"),
    jobs.SynthJob: ("synth", "run_synth"),
    jobs.EvaluateJob: ("evaluate", "run_evaluate"),
    jobs.ExportJob: ("export", "run_export"),
    jobs.CheckJob: ("check", "run_check"),
    jobs.CompareJob: ("compare", "run_compare"),
    BenchJob: ("bench", "run_bench"),
    jobs.InspectJob: ("inspect", "run_inspect"),
    ConvertModelJob: ("convert", "run_convert"),
    jobs.CalibrateJob: ("calibrate", "run_calibrate"),
    jobs.GalleryJob: ("gallery", "run_gallery"),
    VocabulariesJob: ("vocabularies", "run_vocabularies"),
    DoctorJob: ("doctor", "run_doctor"),
}
"""A job's type -> the module of this package, and the function in it, that does the job."""


def runner(job: type) -> Callable[[jobs.Job], ExitCode]:
    """The function that does the jobs of one type."""
    module, name = RUNNERS[job]
    function: Callable[[jobs.Job], ExitCode] = getattr(
        import_module(f"animal3dbox.cli.{module}"), name
    )
    return function


def run_job(job: jobs.Job) -> ExitCode:
    """Do what a job's options ask for; the exit code says how it ended.

    Raises:
        ConfigError: options that cannot be.
        Animal3DBoxError: input that cannot be used.
        OSError: output that cannot be written.

    """
    return runner(type(job))(job)
