"""The command `gallery`: pictures of a sample of a table's labels."""

from animal3dbox.cli.exit_codes import ExitCode
from animal3dbox.cli.jobs import GalleryJob
from animal3dbox.plurals import counted
from animal3dbox.report.table.table_gallery import write_table_gallery


def run_gallery(job: GalleryJob) -> ExitCode:
    """Draw a sample of a table into one page."""
    has_name = job.path.name not in ("", "..")
    folder = job.path if has_name else job.path.resolve()
    page = job.out or folder.parent / f"{folder.name}-gallery.html"
    shown = write_table_gallery(
        job.path,
        page,
        worst=job.worst,
        random=job.random,
        seed=job.seed,
        images=job.images,
    )
    print(f"{counted(shown, 'label')}: look at {page}")
    return ExitCode.OK
