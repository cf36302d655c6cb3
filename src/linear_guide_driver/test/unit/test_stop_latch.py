# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
import itertools
import random

import pytest

from linear_guide_driver.stop_latch import EmergencyInput, StopLatch, StopState

MS = 1_000_000
TOPIC = '/robot/emergency_stop'


def make_with_emergency(timeout_s=0.5):
    latch = StopLatch()
    latch.emergency = EmergencyInput(TOPIC, timeout_s)
    return latch


def connect(*latches):
    """Pass each state to all other latches immediately, as the topic does."""
    for latch in latches:

        def publish(latch=latch):
            for other in latches:
                other.take(latch.state, str(id(latch)))

        latch.join(publish, lambda: len(latches))


def test_a_stop_latches_until_it_is_reset():
    latch = StopLatch()
    assert latch.find_loss(0) is None
    latch.stop('Stop was pressed on linear_guide')
    text = 'The rig is stopped: Stop was pressed on linear_guide; remove the cause, then call'
    assert str(latch.find_loss(0)).startswith(text)
    assert str(latch.find_loss(10**15)).startswith(text)
    assert latch.reset(0) is None
    assert latch.find_loss(0) is None
    assert latch.reset(0) is None
    assert latch.state.number == 2  # a reset of a rig that is not stopped changes nothing


def test_a_rig_that_is_stopped_keeps_its_first_reason():
    latch = StopLatch()
    latch.stop('the first')
    latch.stop('the second')
    assert latch.state == StopState(2, True, 'the first')


def test_every_node_knows_a_stop_and_a_reset():
    guide, tendon, runner = rig = [StopLatch() for _ in range(3)]
    connect(*rig)
    tendon.stop('pressed')
    assert {latch.state for latch in rig} == {StopState(1, True, 'pressed')}
    assert runner.reset(0) is None
    assert not any(latch.state.is_stopped for latch in rig)
    guide.stop('again')
    assert all(latch.state.is_stopped for latch in rig)


def test_a_node_that_starts_again_is_stopped_like_the_others():
    guide, fresh = StopLatch(), StopLatch()
    guide.stop('pressed')
    fresh.join(lambda: None, lambda: 2)  # two nodes: this one and the guide
    fresh.take(fresh.state, 'fresh')
    assert not fresh.was_heard
    fresh.take(guide.state, 'guide')
    assert fresh.was_heard
    assert fresh.find_loss(0) is not None


def test_of_a_stop_and_a_reset_at_the_same_time_the_stop_wins():
    for order in itertools.permutations(range(2)):
        one, other = StopLatch(), StopLatch()
        one.stop('first')
        other.take(one.state, 'one')
        one.reset(0)
        other.stop('second')
        states = [one.state, other.state]
        for i in order:
            one.take(states[i], 'x')
            other.take(states[i], 'x')
        assert one.state == other.state
        assert one.state.is_stopped


@pytest.mark.parametrize('seed', range(50))
def test_copies_become_equal_in_whatever_order_states_arrive(seed):
    choose = random.Random(seed)
    latches = [StopLatch() for _ in range(3)]
    on_the_way = []
    for latch in latches:

        def publish(latch=latch):
            on_the_way.extend((other, latch.state) for other in latches)

        latch.join(publish, lambda: 0)
    for _ in range(40):
        latch = choose.choice(latches)
        what = choose.choice(['stop', 'stop', 'reset', 'deliver', 'deliver'])
        if what == 'stop':
            latch.stop(f'reason {choose.random()}')
        elif what == 'reset':
            latch.reset(0)
        elif on_the_way:
            receiver, state = on_the_way.pop(choose.randrange(len(on_the_way)))
            receiver.take(state, 'x')
    while on_the_way:
        receiver, state = on_the_way.pop(choose.randrange(len(on_the_way)))
        receiver.take(state, 'x')
    assert len({latch.state for latch in latches}) == 1


# -- the emergency stop ---------------------------------------------------------------------------


def test_an_emergency_stop_that_was_never_heard_refuses_but_does_not_latch():
    latch = make_with_emergency()
    latch.check(10_000 * MS)
    assert not latch.was_heard
    assert TOPIC in str(latch.find_loss(10_000 * MS))
    assert not latch.state.is_stopped
    assert TOPIC in str(latch.reset(0))
    latch.hear_emergency(False, 0)
    assert latch.was_heard
    assert latch.find_loss(0) is None


def test_a_pressed_emergency_stop_latches_although_the_next_message_ends_it():
    latch = make_with_emergency()
    latch.hear_emergency(True, 0)
    assert TOPIC in str(latch.find_loss(0))
    assert 'release the emergency stop' in latch.reset(0).remedy
    latch.hear_emergency(False, 10 * MS)
    assert latch.find_loss(10 * MS) is not None
    assert latch.reset(10 * MS) is None
    assert latch.find_loss(10 * MS) is None


def test_a_lost_emergency_stop_latches_and_forbids_a_reset():
    latch = make_with_emergency(0.5)
    latch.hear_emergency(False, 0)
    latch.check(500 * MS)
    assert latch.find_loss(500 * MS) is None
    latch.check(501 * MS)
    assert 'no message has arrived from the emergency stop' in latch.state.reason
    assert '0.5 s' in latch.reset(600 * MS).reason
    latch.hear_emergency(False, 700 * MS)
    assert latch.state.is_stopped
    assert latch.reset(700 * MS) is None
    assert not latch.state.is_stopped


def test_a_silence_that_only_a_motion_has_seen_latches_too():
    latch = make_with_emergency(0.5)
    changes = []
    latch.join(lambda: changes.append(latch.state), lambda: 0)
    latch.hear_emergency(False, 0)
    assert '0.5 s' in str(latch.find_loss(600 * MS))
    assert not changes  # find_loss may be called under any lock, so it calls no callback
    latch.hear_emergency(False, 601 * MS)
    assert changes == [
        StopState(1, True, f'no message has arrived from the emergency stop on {TOPIC} for 0.5 s')
    ]


def test_a_reset_by_a_node_without_the_input_does_not_outlast_a_pressed_emergency_stop():
    driver, runner = make_with_emergency(), StopLatch()
    connect(driver, runner)
    driver.hear_emergency(True, 0)
    runner.reset(0)
    assert driver.find_loss(0) is not None
    driver.check(0)
    assert runner.state.is_stopped
