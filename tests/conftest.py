"""For all tests: signals do what they do wherever the run was started (the background of a shell ignores Ctrl-C and
Ctrl-backslash, nohup a hang-up), no test fails for being slow, and none plays through a sound card of this machine. Linear
algebra has one thread: several tests run at once, and its threads wait for each other by keeping the processor busy.
Kernels are Numba's, also where a native library has been built, but for the tests of that. The files that take longest
come first, so that none is left for the end while other cores have nothing to do."""

import os
import signal
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings
from threadpoolctl import threadpool_limits

from tests.nocard import hide_sound_card

os.environ.update(hide_sound_card())
os.environ["JAWARI_NATIVE"] = "0"
os.environ["JAWARI_TRIAL"] = "0"  # vectors as wide as the processor's, so that all tests share their kernels
os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1"))  # read by NumPy
threadpool_limits(limits=1, user_api="blas")  # where a plugin of pytest has loaded NumPy before

ROOT = Path(__file__).resolve().parent.parent

settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
for _name in ("SIGQUIT", "SIGHUP", "SIGTERM"):
    if hasattr(signal, _name) and signal.getsignal(getattr(signal, _name)) is signal.SIG_IGN:
        signal.signal(getattr(signal, _name), signal.SIG_DFL)

#: files and folders that only --all runs: they play live, open browsers, build plugins, install packages, compile kernels,
#: fit recordings, break files by the hundred, or repeat at length what another file tests in a second
SLOW = (
    "tests/author/browser/",
    "tests/author/test_buzz_maps_served.py",
    "tests/author/test_contact_served.py",
    "tests/author/test_crowd.py",
    "tests/author/test_end.py",
    "tests/author/test_files.py",
    "tests/author/test_plans.py",
    "tests/author/test_random_steps.py",
    "tests/author/test_sound.py",
    "tests/author/test_speaker.py",
    "tests/author/test_views_served.py",
    "tests/author/views/test_analysis.py",
    "tests/author/views/test_cost.py",
    "tests/author/views/test_motion.py",
    "tests/author/views/test_parameters.py",
    "tests/dataset/test_carried_states.py",
    "tests/dataset/test_crew.py",
    "tests/dataset/test_folder.py",
    "tests/docs/test_blocks.py",
    "tests/docs/test_fresh_pages.py",
    "tests/docs/test_site.py",
    "tests/extending/",
    "tests/fit/test_body_fit.py",
    "tests/fit/test_contact.py",
    "tests/fit/test_fit_recordings.py",
    "tests/fit/test_frets.py",
    "tests/fit/test_plan_measuring.py",
    "tests/fit/test_real.py",
    "tests/fit/test_refusals.py",
    "tests/fit/test_synthetic.py",
    "tests/host/test_batch.py",
    "tests/live/test_drone.py",
    "tests/live/test_jack.py",
    "tests/live/test_jackkit.py",
    "tests/live/test_midiports.py",
    "tests/live/test_pipewire.py",
    "tests/live/test_play.py",
    "tests/live/test_play_keys.py",
    "tests/live/test_portaudio.py",
    "tests/live/test_recorder.py",
    "tests/native/",
    "tests/plugin/",
    "tests/setup/test_truth.py",
    "tests/test_bad_numbers.py",
    "tests/test_bench_against.py",
    "tests/test_bench_coupled.py",
    "tests/test_bench_history.py",
    "tests/test_broken_inputs.py",
    "tests/test_collisions.py",
    "tests/test_collisions_blind.py",
    "tests/test_compiling.py",
    "tests/test_coupled_promise.py",
    "tests/test_every_command.py",
    "tests/test_hands_check.py",
    "tests/test_impostor.py",
    "tests/test_kernel_cache.py",
    "tests/test_kernel_helpers.py",
    "tests/test_kernel_linking.py",
    "tests/test_mutants.py",
    "tests/test_notebooks.py",
    "tests/test_platforms.py",
    "tests/test_prebuilt.py",
    "tests/test_prebuilt_live.py",
    "tests/test_same_sound.py",
    "tests/test_simulation.py",
    "tests/test_study.py",
    "tests/test_sweep_access.py",
    "tests/test_typed.py",
    "tests/test_walls.py",
    "tests/test_wheel.py",
)

#: the same, each with the slash at its end
SLOW_PLACES = tuple(f"{name.rstrip('/')}/" for name in SLOW)

#: cases of tests of other files that only --all runs, by what their ids begin with: a quick case of each test stays
SLOW_CASES = (
    "tests/author/test_toml_edit.py::test_any_number_anywhere[fretted-bass]",
    "tests/author/test_toml_edit.py::test_any_number_anywhere[jawari-harp]",
    "tests/docs/test_docstrings.py::test_the_examples_do_what_they_show[CoupledResult]",
    "tests/engine/test_by_frames.py::test_what_is_drawn_by_frames_sounds_as_in_steps[double-bass",
    "tests/engine/test_by_frames.py::test_what_is_drawn_by_frames_sounds_as_in_steps[nylon-guitar-64",
    "tests/engine/test_sides.py::test_a_string_is_heard_on_either_side_by_its_pan[fretted-bass]",
    "tests/engine/test_strokes.py::test_neither_blocks_nor_threads_nor_a_state_matter[together]",
    "tests/engine/test_threads.py::test_the_interpreter_ends_with_workers_awake[raise",
    "tests/engine/test_threads.py::test_the_interpreter_ends_with_workers_awake[threading",
    "tests/physics/test_ramp_frames.py::test_random_scenes_never_gain_energy[False-1.0]",
    "tests/physics/test_ramp_frames.py::test_random_scenes_never_gain_energy[True",
    "tests/physics/test_ramp_frames.py::test_under_a_body_too_heavy_to_move_it_is_the_uncoupled_step[3]",
    "tests/solver/test_line_culling.py::test_fretted_strings_are_the_twin_s[8]",
    "tests/solver/test_line_culling.py::test_nothing_moves_further_than_is_spent[bridge]",
    "tests/solver/test_line_culling.py::test_nothing_moves_further_than_is_spent[finger]",
    "tests/solver/test_line_culling.py::test_what_is_passed_over_changes_nothing[False-8]",
    "tests/solver/test_line_culling.py::test_what_is_passed_over_changes_nothing[True-8]",
    "tests/solver/test_line_friction.py::test_the_law_holds_in_motion_that_the_twin_makes[2]",
    "tests/solver/test_line_friction.py::test_the_law_holds_in_motion_that_the_twin_makes[8]",
    "tests/solver/test_line_layers.py::test_the_law_holds_in_motion_that_the_twin_makes[8]",
    "tests/solver/test_single.py::test_energy_of_a_string_pressed_for_ten_minutes_never_gathers[bouncing",
    "tests/solver/test_substeps.py::test_several_contacts_against_the_twin[False]",
    "tests/test_indian_strings.py::test_partials_wake_from_above_and_late[tanpura-",
    "tests/test_indian_strings.py::test_the_formant_of_sa_falls_and_does_not_rise_again[tanpura-",
    "tests/test_promise.py::test_promise[fine]",
    "tests/test_quality.py::test_fretted_notes_keep_the_promise[28]",
    "tests/test_quality.py::test_fretted_notes_keep_the_promise[50]",
    "tests/test_selection.py::test_slow_tests_run_where_they_are_asked_for[words1",
    "tests/test_selection.py::test_slow_tests_run_where_they_are_asked_for[words2",
    "tests/test_tuning.py::test_every_position_is_in_tune[fretted-bass",
)

#: of the files that take longest; the first compiles the kernels of an engine, which most others need, and the second those
#: of another level of processors for the native library, while the next five need none; the eighth compiles those of a
#: simulation
LONGEST = (
    "tests/test_every_command.py",
    "tests/plugin/test_library.py",
    "tests/fit/test_real.py",
    "tests/fit/test_synthetic.py",
    "tests/test_kernel_linking.py",
    "tests/fit/test_refusals.py",
    "tests/physics/test_modes.py",
    "tests/test_simulation.py",
    "tests/plugin/test_portable_takes.py",
    "tests/live/test_pipewire.py",
    "tests/plugin/test_systems.py",
    "tests/author/browser/test_page.py",
    "tests/author/browser/test_every_preset.py",
    "tests/docs/test_fresh_pages.py",
    "tests/live/test_play.py",
    "tests/setup/test_truth.py",
    "tests/test_impostor.py",
    "tests/plugin/test_targets.py",
    "tests/fit/test_frets.py",
    "tests/author/browser/test_instrument.py",
    "tests/author/browser/test_hear.py",
    "tests/author/test_end.py",
    "tests/author/browser/test_controls.py",
    "tests/author/browser/test_fit.py",
    "tests/test_presets.py",
    "tests/test_targets.py",
    "tests/plugin/test_wasm_fuzz.py",
    "tests/author/test_files.py",
    "tests/test_hard_cases.py",
    "tests/live/test_recorder.py",
    "tests/author/browser/test_firefox.py",
    "tests/author/test_sound.py",
    "tests/solver/test_lcp_solvers.py",
    "tests/live/test_jack.py",
    "tests/live/test_midiports.py",
    "tests/author/browser/test_save.py",
    "tests/solver/test_fingers.py",
    "tests/test_tuning.py",
    "tests/live/test_drone.py",
    "tests/live/test_portaudio.py",
    "tests/author/test_views_served.py",
    "tests/test_broken_inputs.py",
    "tests/author/browser/test_recovery.py",
    "tests/solver/test_substeps.py",
    "tests/live/test_play_keys.py",
    "tests/author/browser/test_told.py",
    "tests/test_kernel_helpers.py",
    "tests/test_compiling.py",
    "tests/solver/test_blocks.py",
    "tests/test_promise.py",
    "tests/author/browser/test_layout.py",
    "tests/test_walls.py",
    "tests/test_bad_numbers.py",
    "tests/engine/test_blocks.py",
    "tests/author/test_document.py",
    "tests/engine/test_threads.py",
    "tests/author/test_speaker.py",
    "tests/dsp/test_denormals.py",
    "tests/author/browser/test_pictures.py",
    "tests/solver/test_kernels.py",
    "tests/test_cli.py",
    "tests/test_same_sound.py",
)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--all", action="store_true", help="run the tests marked slow, too; tests that are named always run")


def _everything(config: pytest.Config) -> bool:
    """Whether slow tests run, too. A worker is told; it takes all files for named ones."""
    told = getattr(config, "workerinput", None)
    if told is not None:
        return bool(told["everything"])
    return config.getoption("all") or config.args_source is pytest.Config.ArgsSource.ARGS


@pytest.hookimpl(optionalhook=True)
def pytest_configure_node(node: Any) -> None:
    """Tell a worker of pytest-xdist."""
    node.workerinput["everything"] = _everything(node.config)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Where only quick tests run, slow files are not even read."""
    name = collection_path.relative_to(ROOT).as_posix() if collection_path.is_relative_to(ROOT) else ""
    return True if name and (name + "/").startswith(SLOW_PLACES) and not _everything(config) else None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    for item in items:
        if item.nodeid.startswith(SLOW + SLOW_CASES):
            item.add_marker(pytest.mark.slow)
    if not _everything(config):
        slow = [item for item in items if item.get_closest_marker("slow")]
        config.hook.pytest_deselected(items=slow)
        items[:] = [item for item in items if not item.get_closest_marker("slow")]
    places = {name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: places.get(item.nodeid.partition("::")[0], len(LONGEST)))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """One more than cores: many a test waits for time to pass."""
    return (os.cpu_count() or 1) + 1
