"""A fixture that several files need stands once, in a conftest.py; marks of a file are not lost."""

from __future__ import annotations

import ast
from collections import Counter
from pathlib import Path

from tests.architecture.sources import parsed

TESTS = Path(__file__).parents[1]
JUDGED = "test_what_tables_and_set_up_values_can_cure_leaves_nothing"
WHOLLY_LONG = {
    (
        "test_mounts.py",
        "test_one_turn_reads_three_errors_by_their_truth",
    ): "test_one_mounting_counts_once_in_plan_forecast_and_hours",
    (
        "test_ground_by_copy.py",
        "test_the_flank_by_tables_is_the_flank_by_the_copy",
    ): "test_the_simulated_control_cuts_the_same_by_tables_and_by_the_copy",
    (
        "test_hours.py",
        "test_a_run_measures_by_the_plan_and_goes_on_by_it",
    ): "test_an_axis_asks_for_its_own_set_up_and_the_angles_of_its_lever",
    (
        "test_wheel_in_run.py",
        "test_the_wheel_is_dressed_by_what_the_run_told_of_it",
    ): "test_the_best_correction_comes_first_and_each_takes_what_is_its_own",
    (
        "test_order.py",
        "test_the_drive_of_each_step_is_that_of_its_flank",
    ): "test_the_best_correction_comes_first_and_each_takes_what_is_its_own",
    (
        "test_builder_cycle.py",
        "test_the_loop_closes_over_the_builders_cycle",
    ): "test_the_builders_cycle_makes_the_same_part_by_another_way",
    (
        "test_paper.py",
        "test_one_command_makes_the_whole_paper",
    ): "test_every_sheet_of_the_paper_has_its_caption",
    (
        "test_asked.py",
        "test_the_whole_demo_asks_for_what_is_listed_and_the_day_foretells_it",
    ): "test_further_stops_of_a_plan_need_no_press",
    (
        "test_grinding.py",
        "test_a_reversal_is_taken_up_within_a_stroke_only_where_bit_1_is_off",
    ): "tests/unit/tooth/test_reversal_on_tooth.py",
    (
        "test_reversals.py",
        "test_a_constant_reversal_is_gone_at_and_between_the_targets",
    ): "test_the_demo_machines_rotary_axis_gets_better_as_promised",
    (
        "test_reversals.py",
        "test_a_reversal_within_its_scatter_is_left_alone_and_said_to_be",
    ): "tests/unit/correct/test_reversal.py",
    (
        "test_reversals.py",
        "test_what_depends_on_the_position_goes_into_a_pair_of_tables",
    ): "tests/unit/correct/test_reversal.py",
    (
        "test_reversals.py",
        "test_without_room_for_a_pair_what_depends_on_the_position_stays_and_is_never_larger",
    ): "tests/unit/correct/test_reversal.py",
    (
        "test_more_targets.py",
        "test_a_run_measures_more_where_its_axis_hides_something",
    ): "tests/unit/table/test_more_targets.py",
    (
        "test_components.py",
        "test_the_guard_says_whether_an_approved_curve_still_holds",
    ): "tests/unit/guard",
    (
        "test_acting.py",
        "test_c_deviates_on_purpose_as_predicted_and_a_wrong_prediction_is_seen",
    ): "tests/unit/tooth/test_acting.py",
    (
        "test_inspecting.py",
        "test_a_part_is_inspected_and_guards_its_machine",
    ): "test_a_run_from_a_gear_makes_the_next_one_good",
    (
        "test_wire.py",
        "test_a_run_over_the_wires_makes_the_axis_better",
    ): "test_sigterm_in_mid_push_takes_the_release_back_and_says_what_to_press",
    (
        "test_hostile.py",
        "test_a_loose_gib_is_told_what_no_table_cures",
    ): "test_a_wave_that_looks_like_the_first_harmonic_is_refused_before_anything_is_written",
    (
        "test_hostile.py",
        "test_cec_left_on_is_not_built_into_the_axis_own_table",
    ): "tests/unit/table/test_reasons.py",
    (
        "test_scales.py",
        "test_switches_that_only_the_service_may_write_are_refused_with_the_reason",
    ): "tests/push/test_refusals_on_the_wire.py",
    (
        "test_retakes.py",
        "test_two_broken_readings_that_agree_do_not_outvote_the_good_one",
    ): "test_a_broken_reading_is_taken_again_on_the_machine",
    (
        "test_short.py",
        "test_a_plan_from_files_ends_with_a_proposal_for_the_tooth",
    ): "test_what_is_proposed_to_a_machine_of_a_family_makes_it_better",
    (
        "test_records.py",
        "test_round_trip_of_more_values",
    ): "test_round_trip",
    (
        "test_hostile.py",
        "test_measured_without_check_stops_it_is_found_after_the_push",
    ): "test_a_wave_that_looks_like_the_first_harmonic_is_refused_before_anything_is_written",
    (
        "test_checks.py",
        "test_an_instrument_that_counts_the_wrong_optics_is_not_accepted",
    ): "test_what_is_wrong_fails_with_the_next_step",
    (
        "test_part_asked.py",
        "test_reversed_optics_end_a_run_before_its_tables_and_measured_anew_it_goes_on",
    ): "tests/unit/correct/test_agreement.py",
    (
        "test_part_asked.py",
        "test_a_flank_that_became_worse_takes_all_tables_of_the_run_back",
    ): "tests/unit/tooth/test_believed.py",
    (
        "test_plugin.py",
        "test_the_shipped_suite_accepts_a_cell_and_leaves_junit_and_a_sheet",
    ): "test_what_can_be_read_is_accepted_and_what_lies_above_is_said",
    (
        "test_plugin.py",
        "test_writing_asks_for_the_machines_name_and_the_example_runs",
    ): "test_a_fault_by_its_name_is_played",
    (
        "test_conform_command.py",
        "test_the_written_test_fails_until_the_double_says_the_same",
    ): "test_a_comparison_leaves_session_test_and_rows",
    (
        "test_leniencies.py",
        "test_every_question_is_answered_and_the_double_agrees_with_itself",
    ): "test_reading_questions_alone_need_nobody_at_the_machine",
    (
        "test_leniencies.py",
        "test_forty_leniencies_in_one_copy_are_named_and_nothing_else",
    ): "test_leniencies_that_reading_alone_can_tell_are_named",
    (
        "test_leniencies.py",
        "test_the_second_shipped_cell_poses_as_an_unknown_control",
    ): "test_leniencies_that_reading_alone_can_tell_are_named",
    (
        "test_more_targets.py",
        "test_a_worn_guide_gets_more_targets_where_the_tooth_is_ground",
    ): "test_a_hollow_of_a_worn_guide_counts_where_it_lies",
    (
        "test_families.py",
        "test_a_short_run_on_a_machine_of_a_family",
    ): "test_what_is_proposed_to_a_machine_of_a_family_makes_it_better",
    (
        "test_faults.py",
        "test_the_machine_exchanged_between_capture_and_push",
    ): "tests/unit/interlocks/test_interlocks.py",
    (
        "test_faults.py",
        "test_too_few_points_reserved_names_the_machine_data_and_the_number",
    ): "tests/unit/table/test_table.py",
    (
        "test_faults.py",
        "test_a_table_changed_after_the_capture_is_not_overwritten",
    ): "tests/push/test_refusals_on_the_wire.py",
    (
        "test_faults.py",
        "test_apply_without_the_machines_name_opens_nothing",
    ): "test_a_proposal_is_shown_then_pushed",
    ("test_judge.py", "test_a_table_as_steep_as_it_may_be_holds_the_floor_up"): JUDGED,
    ("test_judge.py", "test_no_part_corrected_by_chance_is_better"): JUDGED,
    ("test_judge.py", "test_of_a_tangential_error_38_percent_stay_on_the_disc_of_eleven"): JUDGED,
    ("test_judge.py", "test_the_floor_does_not_depend_on_where_its_search_began"): JUDGED,
    ("test_judge.py", "test_the_work_s_eccentricity_is_kept_out_of_the_tables"): JUDGED,
    (
        "test_language.py",
        "test_a_whole_run_is_told_without_an_english_sentence",
    ): "test_a_certificate_contains_no_english_sentence",
    ("test_layers.py", "test_no_machine_of_many_gets_worse"): "test_no_machine_gets_worse",
    (
        "test_drive_goal_measured.py",
        "test_a_measured_machine_s_drive_has_half_the_error_that_axis_tables_leave_or_what_was_predicted",
    ): "test_the_goal_transmission_leaves_at_most_half_of_what_axis_tables_leave",
    (
        "test_drive_goal_run.py",
        "test_a_run_for_the_drive_halves_its_transmission_error_by_truth",
    ): "test_the_goal_transmission_leaves_at_most_half_of_what_axis_tables_leave",
    (
        "test_match.py",
        "test_what_is_expected_of_a_pair_is_wider_by_a_worse_inspection",
    ): "test_the_drawn_flanks_scatter_as_repeated_inspections_do",
    (
        "test_goal.py",
        "test_a_doubt_of_the_machine_widens_what_is_expected",
    ): "test_the_discs_of_a_drive_are_drawn_by_the_errors_of_their_machine",
    (
        "test_runs_and_refusals.py",
        "test_a_drive_s_expected_figures_are_those_that_a_run_states",
    ): "test_the_discs_of_a_drive_are_drawn_by_the_errors_of_their_machine",
    (
        "test_scales.py",
        "test_a_table_of_the_builder_is_merged_replaced_and_rolled_back_point_by_point",
    ): "test_the_old_table_can_be_put_back_from_its_back_up",
    (
        "test_reversal_opcua.py",
        "test_a_reversal_acts_as_documented_and_is_taken_back",
    ): "test_the_factor_of_the_control_is_no_part_of_the_reversal",
    (
        "test_reversal_opcua.py",
        "test_a_reversal_that_is_locked_is_told_and_changes_nothing",
    ): "test_the_factor_of_the_control_is_no_part_of_the_reversal",
    (
        "test_reversal_opcua.py",
        "test_the_sign_of_a_reversal_is_measured_from_both_sides",
    ): "test_a_control_that_does_not_do_as_its_manual_says_gets_no_reversal",
    (
        "test_main_job.py",
        "test_a_result_file_takes_the_place_of_a_live_capture",
    ): "test_a_mailbox_site_pushes_what_a_result_file_tells",
    (
        "test_short.py",
        "test_a_short_plan_ends_at_the_floor_of_its_machine",
    ): "test_a_plan_from_files_ends_with_a_proposal_for_the_tooth",
    (
        "test_documented_commands.py",
        "test_every_command_that_looks_at_a_control_runs_at_a_simulated_one",
    ): "test_every_command_of_a_block_is_taken_by_the_command_line",
    (
        "test_switches.py",
        "test_ways_of_one_control_are_told_apart_and_nothing_else_is",
    ): "test_leniencies_that_reading_alone_can_tell_are_named",
    (
        "test_stops.py",
        "test_a_recovery_that_leaves_the_old_table_out_ends_as_a_failure",
    ): "test_recovery_switches_off_and_then_restores_however_often_it_was_tried",
    ("test_wire.py", "test_the_gateway_killed_in_the_middle_of_a_push"): "test_killed_in_a_fresh_process",
    (
        "test_site_by_files.py",
        "test_a_table_goes_in_by_files_and_comes_out_again",
    ): "test_each_step_is_a_process_of_its_own",
    (
        "test_site_by_files.py",
        "test_what_waits_for_its_files_is_not_begun_twice",
    ): "test_the_live_tables_come_back_by_files",
    (
        "test_programs_carried.py",
        "test_a_push_is_carried_as_it_is_printed",
    ): "test_a_self_test_is_carried_as_it_is_printed",
    (
        "test_equal_bytes.py",
        "test_equal_seeds_give_equal_bytes_beside_busy_processes_too",
    ): "tests/unit/ground/test_shared_clock.py",
    (
        "test_programs_signed.py",
        "test_a_sign_proof_and_the_layer_of_axis_tables_are_sent_as_printed",
    ): "the other comparisons of tests/cell/test_programs_signed.py",
    (
        "test_programs_signed.py",
        "test_a_layer_in_three_transactions_is_sent_as_printed",
    ): "the other comparisons of tests/cell/test_programs_signed.py",
}
"""Tests that leave `make test` whole, and the smaller one of the same code that stays.

The judge judges closing runs, most of them long themselves.
"""


def _files_with(word: str) -> list[Path]:
    """Files of tests that have a word at all: the others need no parsing."""
    return [path for path in TESTS.rglob("*.py") if word in path.read_text(encoding="utf-8")]


def _fixtures(path: Path) -> list[str]:
    found = [node for node in parsed(path).body if isinstance(node, ast.FunctionDef)]
    return [ast.unparse(node) for node in found if any("fixture" in ast.unparse(one) for one in node.decorator_list)]


def test_no_fixture_is_written_twice() -> None:
    written = Counter(text for path in _files_with("fixture") for text in set(_fixtures(path)))
    assert [text for text, files in written.items() if files > 1] == []


def test_the_marks_of_a_file_are_given_once() -> None:
    """A second assignment would take back the first one without a word."""
    twice = []
    for path in _files_with("pytestmark"):
        nodes = [node for node in parsed(path).body if isinstance(node, ast.Assign)]
        if sum(ast.unparse(node.targets[0]) == "pytestmark" for node in nodes) > 1:
            twice.append(str(path))
    assert twice == []


def test_what_is_long_keeps_a_sample_in_the_default_run() -> None:
    """A whole test may be long only where the file says which smaller one stays."""
    marked = [
        (path.name, node)
        for path in _files_with("pytest.mark.long")
        if path.name.startswith("test_")
        for node in parsed(path).body
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and any(ast.unparse(one) == "pytest.mark.long" for one in node.decorator_list)
    ]
    assert sorted((file, node.name) for file, node in marked) == sorted(WHOLLY_LONG)
