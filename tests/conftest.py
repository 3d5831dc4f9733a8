"""What every test shares: one thread each, so that two workers do not fight for two cores.

The tiers of the tests, and a small dataset to read and to spoil.
"""

import multiprocessing.process
import os
import shutil
import subprocess
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import cv2
import hypothesis
import pytest
import torch
from small_animals import model_of, write_small_animals
from thorough import FAST_EXAMPLES, PROFILE

torch.set_num_threads(1)
cv2.setNumThreads(1)
hypothesis.settings.register_profile(
    "fast", deadline=None, derandomize=True, max_examples=FAST_EXAMPLES, database=None
)
hypothesis.settings.register_profile(
    "ci", deadline=None, derandomize=True, max_examples=100, database=None
)
hypothesis.settings.register_profile("nightly", deadline=None, max_examples=10_000)
hypothesis.settings.load_profile(PROFILE)

PROCESS = frozenset(
    {
        "bench/test_small_edition.py",
        "cli/test_cli.py::test_help_answers_without_loading_torch",
        "cli/test_cli.py::test_stdout_of_a_process_is_one_json",
        "cli/test_cli.py::test_the_module_can_be_run_and_leaves_no_traceback",
        "cli/test_doctor.py::test_a_process_that_gives_no_answer_is_ended",
        "cli/test_doctor.py::test_here_all_works_and_the_json_says_what_is_installed",
        "cli/test_doctor.py::test_the_current_folder_cannot_replace_a_library",
        "cli/test_doctor.py::test_what_is_broken_ends_in_a_code_and_a_remedy",
        "cli/test_label_runs.py",
        "cli/test_label_tables.py",
        "cli/test_worker_batches.py",
        "datasets/synthetic/test_world.py::test_another_process_draws_the_same_scene",
        "datasets/test_loading.py",
        "report/test_gallery_in_browser.py",
        "smal/files/test_pickle_writer.py"
        "::test_pythons_own_unpickler_needs_nothing_but_chumpy_for_it",
        "smal/quadruped/test_quadruped.py"
        "::test_the_body_is_the_same_to_the_bit_on_any_number_of_threads",
        "smal/safe_pickle/test_pickle_reader.py"
        "::test_calls_under_keys_that_nobody_needs_are_not_made_either",
        "smal/safe_pickle/test_pickle_reader.py"
        "::test_every_hostile_file_is_refused_and_nothing_that_it_names_happens",
        "smal/safe_pickle/test_pickle_reader.py::test_the_watch_sees_what_pickle_itself_does",
        "test_docs.py::test_the_readme_s_code_runs_from_top_to_bottom",
        "test_docs.py::test_the_training_loop_of_the_datasets_page_runs",
        "test_examples.py",
        "test_lazy_exports.py::test_importing_a_door_does_not_load_torch",
        "test_package.py::test_importing_the_package_or_its_command_line_does_not_load_torch",
        "test_package.py::test_the_root_folders_refuse_to_be_imported_by_their_bare_names",
        "transforms/kornia_bridge/test_kornia_ops.py"
        "::test_kornia_is_imported_only_for_those_who_use_it",
        "transforms/test_workers.py",
    }
)
"""Files and tests that start processes: interpreters, workers, ranks."""
LONG = frozenset(
    {
        "bench/test_making.py",
        "bench/test_small_edition.py",
        "cli/test_check.py",
        "cli/test_demo.py",
        "cli/test_evaluate.py",
        "cli/test_fill.py",
        "cli/test_synth.py",
        "datasets/inspection/test_inspection.py",
        "datasets/labelling/test_cached_samples.py",
        "datasets/labelling/test_injected_faults.py",
        "datasets/readers/test_animal3d.py"
        "::test_a_written_folder_gives_the_same_labels_as_the_world_in_memory",
        "datasets/readers/test_animal3d_relatives.py",
        "datasets/synthetic/test_foreign_world.py",
        "datasets/synthetic/test_synthetic_set.py",
        "datasets/synthetic/test_world.py",
        "datasets/test_label_dataset.py",
        "datasets/test_samples_in_batches.py",
        "evaluate/test_forty.py",
        "geometry/test_box_overlap.py::test_iou_is_that_of_half_space_intersection",
        "geometry/test_rasterizer.py::test_silhouette_of_a_large_image_is_that_of_every_pixel_centre",
        "geometry/test_visible_surface.py"
        "::test_visible_vertices_are_those_with_a_free_line_of_sight_in_200_posed_views",
        "labels/pose/test_choice.py",
        "labels/test_label_many.py::test_many_labels_are_those_of_one_by_one_to_the_last_bit",
        "report/table/test_label_table.py",
        "report/test_report.py::test_400_cards_stay_below_5_megabytes_and_load_nothing",
        "smal/files/test_model_files.py::test_the_quadruped_survives_a_smal_file_bit_by_bit",
        "test_docstring_examples.py",
        "training/test_check_targets.py"
        "::test_what_a_dataset_gives_raises_nothing_nor_when_augmented",
        "training/test_keypoint_checks.py"
        "::test_generated_animals_raise_nothing_and_most_mirrored_ones_are_found",
        "transforms/rendering/test_pixel_contract.py"
        "::test_blobs_at_projected_corners_are_found_at_the_updated_corners",
    }
)
"""Files and tests that take long: they draw whole worlds, or label and evaluate whole datasets."""
TIERS = {"process": PROCESS, "long": LONG}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests that `make test-fast` leaves out (README.md)."""
    tests = f"{Path(__file__).parent.as_posix()}/"
    for item in items:
        file = item.path.as_posix().removeprefix(tests)
        function = getattr(item, "originalname", item.name)
        for marker, names in TIERS.items():
            if file in names or f"{file}::{function}" in names:
                item.add_marker(marker)


@pytest.fixture(autouse=True)
def no_process_in_the_fast_tier(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the fast tier, fail a test that starts a process without being listed as one that does."""

    def refuse(*_: object, **__: object) -> None:
        pytest.fail("starts a process: list it under PROCESS in tests/conftest.py", pytrace=False)

    if PROFILE == "fast" and request.node.get_closest_marker("process") is None:
        monkeypatch.setattr(subprocess.Popen, "__init__", refuse)
        monkeypatch.setattr(multiprocessing.process.BaseProcess, "start", refuse)


@pytest.fixture(scope="session")
def animals(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight pictures; leave them as they are."""
    return write_small_animals(tmp_path_factory.mktemp("animals") / "set")


@pytest.fixture
def copied(animals: Path, tmp_path: Path) -> Path:
    """A copy of your own."""
    shutil.copytree(animals, tmp_path / "set")
    shutil.copy(model_of(animals), model_of(tmp_path / "set"))
    return tmp_path / "set"
