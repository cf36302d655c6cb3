# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The rules of a motion, with a device that records the calls."""

import pytest

from linear_guide_driver.errors import (
    DeviceConnectionError,
    MotionFailedError,
    MotionRefusedError,
    MotionStoppedError,
)
from linear_guide_driver.motion import Motion, Motions


class Device:
    """Moves in three steps. ``on_step`` is called before each step with its number."""

    def __init__(self, on_step=lambda _: None):
        self.motions = Motions('busy', 'not begun')
        self.told = []
        self._on_step = on_step

    def run(self, on_progress=lambda _: None, should_stop=lambda: False, begin=None):
        motion = Motion(
            begin or self._move,
            lambda: self.told.append('stop') or 'at rest',
            lambda reason: self.told.append('fail') or f'failed: {reason}',
            lambda: self.told.append('abandon'),
            lambda: self.told.append('finish'),
            lambda: self.told.append('brake'),
        )
        return self.motions.run(motion, on_progress, should_stop)

    def _move(self):
        try:
            for step in range(3):
                self._on_step(step)
                self.told.append(step)
                yield None if step == 1 else step
            return 'there'
        finally:
            self.told.append('closed')


def test_a_motion_tells_its_news_and_returns_its_result():
    device, news = Device(), []
    assert device.run(news.append) == 'there'
    assert news == [0, 2]
    assert device.told == [0, 1, 2, 'closed', 'finish']
    assert not device.motions.request_stop()
    assert device.told[-1] == 'finish'


def test_a_second_motion_is_refused_and_the_first_goes_on():
    device, refusals = Device(), []

    def try_another(_):
        with pytest.raises(MotionRefusedError, match='busy') as refusal:
            device.run()
        refusals.append(refusal)

    assert device.run(try_another) == 'there'
    assert len(refusals) == 2
    assert device.told == [0, 1, 2, 'closed', 'finish']


def test_a_refusal_of_the_device_or_a_stop_that_has_come_already_moves_nothing():
    def refuse():
        raise MotionRefusedError('too far')

    device = Device()
    with pytest.raises(MotionRefusedError, match='too far'):
        device.run(begin=refuse)
    with pytest.raises(MotionStoppedError, match='not begun'):
        device.run(should_stop=lambda: True)
    assert device.told == ['finish', 'finish']
    with device.motions.no_motion(0.0), pytest.raises(MotionRefusedError, match='busy'):
        device.run()
    assert device.run() == 'there'


@pytest.mark.parametrize('step', [0, 1, 2])
def test_a_stop_ends_it_once_at_any_step(step):
    device = Device()
    with pytest.raises(MotionStoppedError, match='at rest'):
        device.run(should_stop=lambda: step in device.told)
    assert device.told == [*range(step + 1), 'closed', 'stop', 'finish']


@pytest.mark.parametrize('step', [0, 2])
def test_a_requested_stop_brakes_at_once_and_nothing_continues_it(step):
    def on_step(number):
        if number == step:
            assert device.motions.request_stop()
            device.motions.unless_stopping(lambda: device.told.append('go on'))

    device = Device(on_step)
    with pytest.raises(MotionStoppedError, match='at rest'):
        device.run()
    assert device.told == [*range(step), 'brake', step, 'closed', 'stop', 'finish']


def test_a_stop_after_the_last_step_is_heeded():
    device = Device()

    def move():
        yield None
        assert device.motions.request_stop()
        return 'there'

    with pytest.raises(MotionStoppedError, match='at rest'):
        device.run(begin=move)
    assert device.told == ['brake', 'stop', 'finish']


def test_an_error_of_the_device_fails_the_motion_and_one_of_the_motion_passes():
    def fail(error):
        def on_step(step):
            if step == 1:
                raise error

        return on_step

    device = Device(fail(DeviceConnectionError('no answer')))
    with pytest.raises(MotionFailedError, match='failed: no answer'):
        device.run()
    assert device.told == [0, 'closed', 'fail', 'finish']
    device = Device(fail(MotionFailedError('above the limit')))
    with pytest.raises(MotionFailedError, match=r'^above the limit$'):
        device.run()
    assert device.told == [0, 'closed', 'finish']


def test_a_fault_of_the_caller_stops_the_device():
    def fail(_):
        raise ZeroDivisionError

    device = Device()
    with pytest.raises(ZeroDivisionError):
        device.run(fail)
    assert device.told == [0, 'closed', 'abandon', 'finish']
    assert device.run() == 'there'
