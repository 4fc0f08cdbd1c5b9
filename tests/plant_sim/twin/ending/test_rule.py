"""Rule by which a trial ends, and the rest of a machine as its events tell it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from controller.events.kinds import AlarmEvent, Event, QuestionEvent, StateEvent, as_record
from controller.program.states import State
from controller.program.texts.operator import NO_TEXT, Text
from plant_sim.twin.ending.reported import ReportedEvents, alarm_name
from plant_sim.twin.ending.rule import REST_LIMIT_MS, EndingRule, Rest, TrialEnd

MAX_MS = 60_000
REST = Rest(5_000, "Held: S911 left arm not up after clamping")
END_MS = REST.since_ms + REST_LIMIT_MS
RULE = EndingRule(MAX_MS)


def ending(
    now_ms: int, *, complete: bool = False, rest: Rest | None = REST, rule: EndingRule = RULE
) -> TrialEnd | None:
    return rule.ending(now_ms, complete=complete, rest=rest, state="Held")


def reported(*events: Event) -> ReportedEvents:
    news = ReportedEvents()
    for event in events:
        news.apply(as_record(event))
    return news


def test_a_trial_without_an_operator_ends_after_10_s_of_rest() -> None:
    assert REST_LIMIT_MS == 10_000
    assert ending(END_MS - 10) is None
    assert ending(END_MS) == TrialEnd(END_MS, f"{REST.text}; no operator after 10 s")


def test_a_late_look_does_not_change_the_end() -> None:
    assert ending(END_MS + 7_000) == ending(END_MS)


def test_a_machine_that_does_not_rest_goes_on_to_its_time_limit() -> None:
    assert ending(MAX_MS - 10, rest=None) is None
    assert ending(MAX_MS, rest=None) == TrialEnd(MAX_MS, "not complete after 60 s of machine time: Held")


def test_an_operator_is_waited_for_to_the_time_limit_only() -> None:
    rule = EndingRule(MAX_MS, lambda: True)
    assert ending(MAX_MS - 10, rule=rule) is None
    end = ending(MAX_MS, rule=rule)
    assert end is not None
    assert end.at_ms == MAX_MS


def test_without_a_limit_an_operator_is_waited_for_in_any_case() -> None:
    assert ending(10**9, rule=EndingRule(None, lambda: True)) is None


def test_a_trial_ends_when_the_operator_leaves() -> None:
    there = [True]
    rule = EndingRule(MAX_MS, lambda: there[0])
    assert ending(END_MS + 1_000, rule=rule) is None
    there[0] = False
    assert ending(END_MS + 1_500, rule=rule) == TrialEnd(END_MS + 1_000, f"{REST.text}; no operator after 10 s")


def test_a_complete_machine_ends_the_trial_without_a_reason() -> None:
    assert ending(0, complete=True) == TrialEnd(None, "")


@pytest.mark.parametrize(
    ("now_ms", "rest", "expected"),
    [
        (0, None, 10_000),
        (6_000, REST, 10_000),
        (10_000, REST, END_MS),
        (END_MS, REST, 20_000),
        (MAX_MS - 1, None, MAX_MS),
        (MAX_MS, REST, 70_000),
    ],
)
def test_a_trial_that_only_the_machine_ends_is_looked_at_when_it_may_end(
    now_ms: int, rest: Rest | None, expected: int
) -> None:
    assert RULE.next_look_ms(now_ms, rest, by_machine_only=True) == expected
    assert EndingRule(None).next_look_ms(55_000, None, by_machine_only=True) == 60_000
    assert EndingRule(57_500).next_look_ms(55_000, None, by_machine_only=True) == 57_500


@pytest.mark.parametrize(("now_ms", "expected"), [(0, 100), (150, 200), (END_MS - 50, END_MS)])
def test_any_other_trial_is_looked_at_every_tenth_of_a_second(now_ms: int, expected: int) -> None:
    assert RULE.next_look_ms(now_ms, REST) == expected


ALARM = AlarmEvent(1_000, 911, active=True, text=Text.plain("other words"))


@pytest.mark.parametrize("state", [State.STOPPED, State.IDLE, State.HELD, State.ABORTED])
def test_a_state_that_only_an_operator_ends_is_rest_from_the_moment_of_both(state: State) -> None:
    name = state.name.capitalize()
    rest = reported(ALARM, StateEvent(4_000, state, Text.plain("zh"))).rest
    assert rest == Rest(4_000, f"{name}: S911 left arm not up after clamping")
    late = reported(StateEvent(4_000, state, Text.plain("zh")), AlarmEvent(7_000, 911, active=True, text=NO_TEXT)).rest
    assert late is not None
    assert late.since_ms == 7_000


@pytest.mark.parametrize("state", [State.EXECUTE, State.HOLDING, State.RESETTING, State.SUSPENDED])
def test_a_state_that_ends_by_itself_is_no_rest(state: State) -> None:
    assert reported(ALARM, StateEvent(4_000, state, Text.plain("zh"))).rest is None


def test_rest_without_an_alarm_or_a_question_says_so() -> None:
    rest = Rest(4_000, "Held, without an alarm or a question")
    assert reported(StateEvent(4_000, State.HELD, Text.plain("Held"))).rest == rest
    cleared = AlarmEvent(6_000, 911, active=False, text=NO_TEXT)
    assert reported(ALARM, StateEvent(4_000, State.HELD, NO_TEXT), cleared).rest == replace(rest, since_ms=6_000)


def test_only_rest_without_an_alarm_counts_from_the_last_press_of_the_operator() -> None:
    news = reported(StateEvent(4_000, State.IDLE, NO_TEXT))
    news.acted(9_000)
    assert news.rest is not None
    assert news.rest.since_ms == 9_000
    news = reported(ALARM, StateEvent(4_000, State.IDLE, NO_TEXT))
    news.acted(9_000)
    assert news.rest is not None
    assert news.rest.since_ms == 4_000


def test_an_open_question_is_told() -> None:
    asked = QuestionEvent(2_000, "left_loaded", active=True, text=Text.plain("左臂是否夹有苗？"))
    held = StateEvent(2_000, State.HELD, Text.plain("Held"), Text.plain("operator answer required"))
    assert reported(held, asked).rest == Rest(2_000, "Held: Is the left arm holding seedlings?")
    answered = replace(asked, at_ms=3_000, active=False)
    rest = reported(held, asked, answered).rest
    assert rest is not None
    assert (rest.since_ms, rest.text) == (3_000, "Held, without an alarm or a question")


def test_a_machine_that_works_again_rests_anew() -> None:
    again = (StateEvent(5_000, State.EXECUTE, NO_TEXT), StateEvent(9_000, State.HELD, NO_TEXT))
    rest = reported(ALARM, StateEvent(4_000, State.HELD, NO_TEXT), *again).rest
    assert rest is not None
    assert rest.since_ms == 9_000


def test_an_alarm_has_the_name_of_the_alarm_table() -> None:
    assert alarm_name(911, "other words") == "S911 left arm not up after clamping"
    assert alarm_name(7, "other words") == "S7 other words"
