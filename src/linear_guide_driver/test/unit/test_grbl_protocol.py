# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from itertools import pairwise

from hypothesis import given, settings
from hypothesis import strategies as st
import pytest

from linear_guide_driver.config import LinearGuideConfig
from linear_guide_driver.errors import DeviceRefusedError
from linear_guide_driver.grbl.protocol import (
    Alarm,
    Banner,
    compute_piece_s,
    cut_move,
    encode_pieces,
    Error,
    GrblDecoder,
    GuideSettings,
    MAX_LINE_BYTES,
    Message,
    Ok,
    Setting,
    STATES,
    StatusReport,
)

coordinates = st.integers(-999_999, 999_999).map(lambda n: n / 1000)
axes = st.tuples(coordinates, coordinates, coordinates)
words = st.text('ABCabc0123456789:.,_ ', max_size=40)
reports = st.builds(
    StatusReport,
    state=st.sampled_from(sorted(STATES)),
    substate=st.none() | st.integers(0, 3),
    mpos_mm=axes,
    feed_mm_min=st.none() | st.integers(0, 9999).map(float),
)
events = st.one_of(
    st.just(Ok()),
    st.builds(Error, st.integers(1, 99)),
    st.builds(Alarm, st.integers(1, 11)),
    st.builds(Setting, st.integers(0, 132), st.sampled_from(['0', '250.000', '-1'])),
    st.builds(Banner, st.sampled_from(['1.1h', '1.1f']), st.booleans()),
    st.builds(Message, words),
    reports,
)
GARBAGE = [
    b'o', b'okk', b' ok', b'OK', b'error:', b'error:x', b'error:2a', b'xxerror:9', b'ALARM:',
    b'Alarm:1', b'<Idle>', b'<Idle|MPos:1.0,nan,0.0>', b'<Idle|MPos:1.0,,0>', b'<Run|FS:1,0>',
    b'<Idle|MPos:1,2,3', b'Idle|MPos:1,2,3>', b'<Nap|MPos:1,2,3>',
    b'<Idle|MPos:1,2,3|FS:9x,0>',
    b'<Idle|MPos:1,2,3|WPos:1,2,3>', b'$x=1', b'$1', b'Grb 1.1h', b'\xff\x00ok', b'[MSG:half',
    b'ok\x00', b'x' * (MAX_LINE_BYTES + 5),
]  # fmt: skip
garbage = st.sampled_from(GARBAGE)


def encode_event(event):
    """Return the line with which a controller reports an event."""
    if isinstance(event, Ok):
        text = 'ok'
    elif isinstance(event, Error):
        text = f'error:{event.code}'
    elif isinstance(event, Alarm):
        text = f'ALARM:{event.code}'
    elif isinstance(event, Setting):
        text = f'${event.number}={event.value}'
    elif isinstance(event, Banner):
        name, question = ('GrblHAL', "'$' or '$HELP'") if event.is_hal else ('Grbl', "'$'")
        text = f'{name} {event.version} [{question} for help]'
    elif isinstance(event, Message):
        text = event.text if event.text.startswith('>') else f'[{event.text}]'
    else:
        state = event.state if event.substate is None else f'{event.state}:{event.substate}'
        text = f'<{state}|MPos:' + ','.join(f'{value:.3f}' for value in event.mpos_mm)
        text += '' if event.feed_mm_min is None else f'|FS:{event.feed_mm_min:.0f},0'
        text += '|Pn:PXZ>' if event.mpos_mm[0] < 0 else '>'  # active inputs: ignored
    return text.encode() + b'\r\n'


def decode_in_chunks(data, cuts):
    decoder = GrblDecoder()
    decoded = []
    edges = sorted({0, len(data), *(cut % (len(data) + 1) for cut in cuts)})
    for low, high in pairwise(edges):
        decoded += decoder.feed(data[low:high])
    return decoded, decoder


@settings(max_examples=50)
@given(st.lists(events | garbage, max_size=20), st.lists(st.integers(0, 10_000), max_size=30))
def test_any_chunking_gives_the_same_events_and_garbage_gives_none(items, cuts):
    data = b''.join(i + b'\r\n' if isinstance(i, bytes) else encode_event(i) for i in items)
    decoded, decoder = decode_in_chunks(data, cuts)
    assert decoded == [i for i in items if not isinstance(i, bytes)]
    assert decoder.garbage_lines == sum(isinstance(i, bytes) for i in items)


@given(st.binary(max_size=3000), st.lists(st.integers(0, 3000), max_size=20))
def test_random_bytes_never_raise_and_chunking_does_not_matter(data, cuts):
    whole, _ = decode_in_chunks(data, [])
    assert decode_in_chunks(data, cuts)[0] == whole
    assert b'\n' in data or whole == []


def test_no_garbage_is_taken_for_an_event():
    for line in GARBAGE:
        decoder = GrblDecoder()
        assert decoder.feed(line + b'\r\n') == [], line
        assert decoder.garbage_lines == 1


def test_memory_is_bounded_by_one_line():
    decoder = GrblDecoder()
    for _ in range(20):
        assert decoder.feed(b'x' * 100) == []
        assert len(decoder._partial) <= MAX_LINE_BYTES
    assert decoder.feed(b'\r\nok\r\n') == [Ok()]
    assert decoder.garbage_lines == 1


def test_known_good_bytes():
    decoder = GrblDecoder()
    assert decoder.feed(
        b"\r\nGrbl 1.1h ['$' for help]\r\n[MSG:'$H'|'$X' to unlock]\r\n"
        b'[VER:1.1h.20190830:]\r\n[OPT:V,15,128]\r\nok\r\n'
        b'$110=500.000\r\n>G20G54G17:ok\r\nerror:22\r\nALARM:1\r\n'
        b"GrblHAL 1.1f ['$' or '$HELP' for help]\r\n"
    ) == [
        Banner('1.1h'),
        Message("MSG:'$H'|'$X' to unlock"),
        Message('VER:1.1h.20190830:'),
        Message('OPT:V,15,128'),
        Ok(),
        Setting(110, '500.000'),
        Message('>G20G54G17:ok'),
        Error(22),
        Alarm(1),
        Banner('1.1f', is_hal=True),
    ]
    assert decoder.garbage_lines == 0


def test_a_work_position_needs_the_offset_and_a_restart_forgets_it():
    decoder = GrblDecoder()
    (before,) = decoder.feed(b'<Idle|WPos:1.000,0.000,0.000|FS:0,0>\r\n')
    assert before.mpos_mm is None
    (first,) = decoder.feed(
        b'<Hold:0|WPos:1.000,2.000,3.000|Bf:15,128|F:900|WCO:-10.000,0.000,0.500>\r\n'
    )
    assert first.mpos_mm == (-9.0, 2.0, 3.5)
    assert (first.state, first.substate, first.feed_mm_min) == ('Hold', 0, 900.0)
    (later,) = decoder.feed(b'<Run|WPos:4.000,2.000,3.000|FS:900,0|Ov:100,100,100>\r\n')
    assert later.mpos_mm == (-6.0, 2.0, 3.5)
    decoder.feed(b"Grbl 1.1h ['$' for help]\r\n")
    (after,) = decoder.feed(b'<Idle|WPos:1.000,0.000,0.000>\r\n')
    assert after.mpos_mm is None


def test_codes_have_a_meaning_and_unknown_ones_say_so():
    assert str(Error(22)) == 'error:22 (no feed rate was given)'
    assert str(Error(99)) == 'error:99 (see the codes of Grbl 1.1)'
    assert str(Alarm(99)) == 'ALARM:99 (see the codes of Grbl 1.1)'


# -- moves ------------------------------------------------------------------------------------


def test_the_lines_of_a_move_end_with_a_dwell():
    # A line has 27 bytes, so four lines fit into the 127 bytes of the receive buffer.
    assert compute_piece_s(0.25, 15) == pytest.approx(0.25 / 19)
    assert compute_piece_s(0.25, 500) == 0.005
    assert list(encode_pieces(-10.0, -9.0, 50.0, 0.01)) == [
        b'G53 G1 X-9.500 F3000.000\n',
        b'G53 G1 X-9.000 F3000.000\n',
        b'G4 P0.010\n',
    ]
    assert list(cut_move(-10.0, -10.0, 0.5)) == [-10.0]


@settings(max_examples=50)
@given(start=st.floats(-500, 0), end=st.floats(-500, 0), piece=st.floats(0.05, 10))
def test_pieces_are_few_go_one_way_are_short_and_end_on_the_target(start, end, piece):
    points = [start, *cut_move(start, end, piece)]
    assert points[-1] == end
    assert len(points) - 2 <= abs(end - start) / piece
    steps = [b - a for a, b in pairwise(points)]
    assert all(abs(step) <= piece * (1 + 1e-6) for step in steps)
    assert all(step * (end - start) >= 0 for step in steps)


# -- settings ---------------------------------------------------------------------------------

LINES = {
    13: '0', 20: '1', 22: '1', 24: '60.000', 25: '600.000', 27: '1.000', 100: '250.000',
    110: '6000.000', 120: '500.000', 130: '200.000',
}  # fmt: skip


def test_durations_by_hand():
    settings = GuideSettings.from_lines(LINES)
    # 30 mm at 15 mm/s take 2 s; acceleration and braking with 500 mm/s^2 add 30 ms.
    assert settings.compute_move_duration_s(-0.03, 0.015) == pytest.approx(2.03)
    # Seeking: 300 mm at 10 mm/s. Approaching the switch: 10 mm at 1 mm/s. Acceleration: 20 ms.
    assert settings.compute_homing_timeout_s() == pytest.approx(40.02)


@pytest.mark.parametrize(
    ('number', 'value', 'text'),
    [
        *((120, value, rf'setting \$120 is {value}') for value in ('nan', 'inf', '-1', '0', 'x')),
        (130, None, r'\$130 is missing'),
        (13, '1', r'set \$13=0'),
        (20, '0', r'set \$20=1'),
        (22, '0', r'set \$22=1'),
        (22, '4', r'set \$22=1'),  # a mask in grblHAL
        (110, '500.000', 'limits the speed to 500 mm/min'),
        (100, '5.000', r'5 steps per millimetre.*\$100'),
        (100, '1600.000', '160000 steps/s'),
        (130, '300.000', 'travel is 300 mm'),
    ],
)
def test_a_setting_that_would_change_a_glide_is_refused(number, value, text):
    lines = {n: v for n, v in {**LINES, number: value}.items() if v is not None}
    with pytest.raises(DeviceRefusedError, match=text):
        GuideSettings.from_lines(lines).check(LinearGuideConfig(), 'V')


def test_settings_that_fit_are_taken():
    GuideSettings.from_lines({**LINES, 22: '5'}).check(LinearGuideConfig(), 'V')
    fast = GuideSettings.from_lines({**LINES, 100: '1600.000'})
    fast.check(LinearGuideConfig(), 'V', is_hal=True)
    with pytest.raises(DeviceRefusedError, match='HOMING_FORCE_SET_ORIGIN'):
        fast.check(LinearGuideConfig(), 'VZ', is_hal=True)
