# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Readings and blocks from the messages of a topic, and diagnosis of its problems."""

import math
from types import SimpleNamespace

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from tactile_ros.strain import StrainStatus
from tendon_sensor_driver import TendonSensorConfig
from tendon_sensor_driver.topic_sensor import (
    choose_type,
    find_publisher_problem,
    find_stream_problem,
    Publisher,
)
from tendon_sensor_driver.topic_stream import READERS, ReadingError, TopicReading, TopicStream

START_NS = 1_795_378_589_611_991_580
WRENCH, FLOAT = 'geometry_msgs/msg/WrenchStamped', 'std_msgs/msg/Float64'
JOINTS = 'sensor_msgs/msg/JointState'


def configure(**options):
    return TendonSensorConfig(**{'sensor': 'topic', 'topic': '/force', **options})


def header(sec=3, nanosec=5):
    return SimpleNamespace(stamp=SimpleNamespace(sec=sec, nanosec=nanosec))


def wrench(*values):
    force = SimpleNamespace(x=values[0], y=values[1], z=values[2])
    torque = SimpleNamespace(x=values[3], y=values[4], z=values[5])
    return SimpleNamespace(force=force, torque=torque)


def joints(names, efforts, stamp=None):
    return SimpleNamespace(header=stamp or header(), name=names, effort=efforts)


# -- messages ------------------------------------------------------------------------------


WRENCH_VALUES = [2.0, 3.0, 6.0, 4.0, 5.0, 9.0]


@pytest.mark.parametrize(
    ('axis', 'expected', 'components'),
    [('fx', 2.0, WRENCH_VALUES), ('ty', 5.0, WRENCH_VALUES), ('norm', 7.0, None)],
)
def test_a_component_of_a_wrench_or_its_norm_is_the_tension(axis, expected, components):
    plain, config = wrench(*WRENCH_VALUES), configure(axis=axis, scale=-2.0)
    stamped = SimpleNamespace(header=header(), wrench=plain)
    reading = READERS['geometry_msgs/msg/Wrench'](plain, config)
    assert reading == TopicReading(None, -2.0 * expected, components)
    assert READERS[WRENCH](stamped, config) == reading._replace(stamp_ns=3_000_000_005)
    stamped.header = header(0, 0)  # zero means that there is no stamp
    assert READERS[WRENCH](stamped, config) == reading


def test_a_plain_number_is_scaled_and_has_no_stamp():
    reading = READERS[FLOAT](SimpleNamespace(data=0.5), configure(scale=9.80665))
    assert reading == TopicReading(None, 0.5 * 9.80665)


def test_a_joint_is_found_by_name_in_any_order_and_its_torque_becomes_tension():
    config = configure(joint='tendon', scale=1 / 0.007)
    for names, efforts in ((['a', 'tendon'], [1.0, 0.07]), (['tendon', 'a'], [0.07, 1.0])):
        reading = READERS[JOINTS](joints(names, efforts), config)
        assert reading.tension_n == pytest.approx(10.0)
        assert reading.stamp_ns == 3_000_000_005
    assert READERS[JOINTS](joints(['only'], [2.0]), configure()).tension_n == 2.0


@pytest.mark.parametrize(
    ('names', 'efforts', 'joint', 'named'),
    [
        (['a', 'b'], [1.0, 2.0], 'c', 'joint c.* a, b'),
        (['a', 'b'], [1.0, 2.0], '', '"joint"'),
        ([], [], '', 'joint'),
        (['a', 'b'], [], 'a', 'joint a '),
        (['a', 'b'], [1.0], 'b', 'joint b '),
    ],
)
def test_joint_states_without_the_effort_say_what_is_missing(names, efforts, joint, named):
    with pytest.raises(ReadingError, match=named):
        READERS[JOINTS](joints(names, efforts), configure(joint=joint))


@pytest.mark.parametrize('axis', ['x', 'FX', 'force.x'])
def test_an_unknown_axis_is_refused_with_the_known_ones(axis):
    # In TOPIC:NAME, a name that is not an axis is taken for a joint.
    stamped = SimpleNamespace(header=header(3, 5), wrench=None)
    with pytest.raises(ReadingError, match='its axes are fx, fy, fz, tx, ty, tz, norm'):
        READERS[WRENCH](stamped, configure(joint=axis))
    with pytest.raises(ReadingError, match='has no joint'):
        READERS[FLOAT](SimpleNamespace(data=0.5), configure(joint=axis))


@given(
    st.lists(st.sampled_from(['', 'a', 'b', 'ä']), max_size=4),
    st.lists(st.floats(), max_size=4),
    st.sampled_from(['', 'a', 'b']),
    st.floats(-1e12, 1e12).filter(bool),
)
def test_any_joint_state_is_a_reading_or_a_sentence(names, efforts, joint, scale):
    try:
        reading = READERS[JOINTS](joints(names, efforts), configure(joint=joint, scale=scale))
    except ReadingError:
        assert not joint or joint not in names or names.index(joint) >= len(efforts)
    else:
        index = names.index(joint) if joint or len(names) > 1 else 0
        expected = scale * efforts[index]
        assert reading.tension_n == expected or math.isnan(expected)


# -- readings to blocks --------------------------------------------------------------------


def feed(stream, readings):
    """Return the blocks of (stamp, tension) pairs that arrive 1 ms after their stamps."""
    blocks = []
    for stamp_ns, tension_n in readings:
        blocks += stream.add(TopicReading(stamp_ns, tension_n), stamp_ns + 1_000_000)
    return [*blocks, *stream.flush()]


@pytest.mark.parametrize('samples_per_block', [1, 20])
def test_a_thousand_a_second_with_jitter_and_drops_become_numbered_blocks(samples_per_block):
    jitter_ns = np.random.default_rng(1).integers(-300_000, 300_000, 5000).tolist()
    numbers = [i for i in range(5000) if i % 97 != 50]
    stamps_ns = {i: START_NS + i * 1_000_000 + jitter_ns[i] for i in numbers}
    stream = TopicStream(configure(rate_hz=1000.0, samples_per_block=samples_per_block))
    blocks = feed(stream, [(stamps_ns[i], float(i)) for i in numbers])
    samples = {
        block.sequence + i: (block.stamp_ns + i * block.period_ns, value, block.stamp_error_s)
        for block in blocks
        for i, value in enumerate(block.tension_n)
    }
    assert [int(value) for _, value, _ in samples.values()] == numbers == list(samples)
    assert sum(block.lost_before for block in blocks) == 5000 - len(numbers)
    for number, (stamp_ns, _, error_s) in samples.items():
        assert abs(stamp_ns - stamps_ns[number]) <= error_s * 1e9
    assert {block.status for block in blocks} == {StrainStatus.OK}


def test_arrival_is_taken_where_it_is_wanted_and_the_offset_added():
    stream = TopicStream(configure(topic_stamps='arrival', offset_n=0.25))
    (block,) = stream.add(TopicReading(START_NS, 1.5), START_NS + 7)
    assert (block.stamp_ns, block.status) == (START_NS + 7, StrainStatus.HOST_TIME)
    assert block.tension_n[0] == 1.75


def test_a_rate_of_zero_is_measured_first():
    stream = TopicStream(configure(rate_hz=0.0))
    readings = [(START_NS + i * 4_000_000, 1.0) for i in range(1000)]
    blocks = feed(stream, readings)
    assert stream.rate_hz == pytest.approx(250.0)
    assert sum(len(block.tension_n) for block in blocks) == 499
    assert {block.period_ns for block in blocks} == {4_000_000}


def test_a_publisher_that_comes_back_and_a_clock_that_is_set_are_told():
    stream = TopicStream(configure(rate_hz=100.0))
    stamps = [START_NS + i * 10_000_000 for i in range(10)]
    feed(stream, [(stamp, 1.0) for stamp in stamps[:5]])
    stream.note_reconnection()
    (back,) = feed(stream, [(stamps[5], 1.0)])
    stream.note_clock_step(5_000_000_000)
    first, second = feed(stream, [(stamp + 5_000_000_000, 1.0) for stamp in stamps[6:9]])[:2]
    assert back.status == StrainStatus.RECONNECTED
    assert first.status & StrainStatus.CLOCK_STEP
    assert second.status == StrainStatus.OK
    assert not first.status & StrainStatus.RESTARTED  # so the tare is not cleared


@settings(max_examples=150)
@given(
    st.lists(
        st.tuples(
            st.integers(-5, 30).map(lambda ms: ms * 1_000_000)
            | st.sampled_from([-(10**10), 10**10]),
            st.floats(),
            st.sampled_from(['', '', '', '', 'unstamped', 'back', 'step']),
        ),
        max_size=80,
    ),
    st.integers(1, 7),
    st.sampled_from([0.0, 60.0, 100.0]),
)
def test_each_reading_is_in_one_block_or_counted(steps, samples_per_block, rate_hz):
    stream = TopicStream(configure(samples_per_block=samples_per_block, rate_hz=rate_hz))
    stamp_ns, arrival_ns, blocks, offered = START_NS, START_NS, [], 0
    for step_ns, value, event in steps:
        stamp_ns += step_ns
        arrival_ns += max(0, min(step_ns, 10**9))
        if event == 'back':
            stream.note_reconnection()
        if event == 'step':
            stream.note_clock_step(10**9)
            arrival_ns += 10**9
        offered += stream.samples is not None
        blocks += stream.add(
            TopicReading(None if event == 'unstamped' else stamp_ns, value), arrival_ns
        )
    blocks += stream.flush()
    taken = sum(len(block.tension_n) for block in blocks)
    if stream.samples is not None:
        clock = stream.clock
        dropped = clock.duplicates + clock.late_samples + clock.outliers
        assert taken + dropped == offered
    following = 0
    for block in blocks:
        assert 1 <= len(block.tension_n) <= samples_per_block
        assert block.sequence == following + block.lost_before
        following = block.sequence + len(block.tension_n)
        finite = np.isfinite(block.tension_n)
        assert finite.all() or bool(block.status & StrainStatus.DEVICE_ERROR)


# -- messages about a topic -----------------------------------------------------------------


def test_a_topic_that_nobody_publishes_or_with_a_wrong_type_says_what_to_do():
    assert '/force has no publisher' in str(find_publisher_problem('/force', [], None))
    image = Publisher('/camera', 'sensor_msgs/msg/Image')
    problem = str(find_publisher_problem('/force', [image], None))
    assert 'sensor_msgs/msg/Image' in problem
    assert WRENCH in problem
    fresh = find_publisher_problem('/force', [Publisher('/ft', WRENCH)], None)
    assert 'not subscribed yet' in str(fresh)
    assert find_publisher_problem('/force', [Publisher('/ft', WRENCH)], WRENCH) is None
    refused = Publisher('/ft', WRENCH, 'ERROR: Best effort publisher')
    assert 'incompatible QoS: ERROR' in str(find_publisher_problem('/f', [refused], WRENCH))
    assert find_publisher_problem('/f', [refused, Publisher('/b', WRENCH)], WRENCH) is None


def test_the_type_is_that_of_the_first_that_fits_and_stays_while_it_is_there():
    image, force = Publisher('/camera', 'sensor_msgs/msg/Image'), Publisher('/ft', WRENCH)
    number = Publisher('/n', FLOAT)
    assert choose_type([image]) is None
    assert choose_type([image, force, number]) == WRENCH
    assert choose_type([image, force, number], FLOAT) == FLOAT
    assert choose_type([force], FLOAT) == WRENCH


def test_what_is_wrong_with_a_stream_is_said_with_its_remedy():
    publishers = [Publisher('/ft', WRENCH)]

    def describe(stream, publishers=publishers, **options):
        options = {'is_silent': False, **options}
        return find_stream_problem('/force', stream, publishers, **options) or ''

    stream = TopicStream(configure(rate_hz=100.0))
    feed(stream, [(START_NS + i * 10_000_000, 1.0) for i in range(300)])
    assert describe(stream) == ''
    assert 'check that its controller is active' in describe(stream, is_silent=True)
    assert '2 publishers (/ft, /other)' in describe(
        stream, [*publishers, Publisher('/other', WRENCH)]
    )
    feed(stream, [(START_NS + 3_000_000_000, 1.0)] * 12)
    assert 'set topic_stamps to arrival' in describe(stream)
    feed(stream, [(START_NS + 3_010_000_000, 1.0)] * 2)
    assert describe(stream) == ''

    stream = TopicStream(configure(rate_hz=100.0))
    feed(stream, [(START_NS + i * 20_000_000, 1.0) for i in range(300)])
    assert 'at 50.00 Hz, but rate_hz is 100; set rate_hz of this node to 50' in describe(stream)

    for offset_ns, way in ((5_000_000_000, '4.999 s ahead of'), (-(10**9), '1.001 s behind')):
        stream = TopicStream(configure())
        stream.add(TopicReading(START_NS + offset_ns, 1.0), START_NS + 1_000_000)
        assert f'the stamps are {way} the time of this node' in describe(stream)
