"""The command `gallery`: pictures of a sample of a table's labels."""

from animal3dbox.cli.exit_codes import ExitCode
from animal3dbox.cli.jobs import GalleryJob
from animal3dbox.report.table.table_gallery import write_table_gallery


def run_gallery(job: GalleryJob) -> ExitCode:
    """Draw a sample of a table into one page."""
    page = job.out or job.path.with_name(f"{job.path.name}-gallery.html")
    shown = write_table_gallery(
        job.path,
        page,
        worst=job.worst,
        random=job.random,
        seed=job.seed,
        images=job.images,
    )
    print(f"{shown} labels: look at {page}")
    return ExitCode.OK
