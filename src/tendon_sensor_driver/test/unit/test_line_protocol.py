# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from itertools import pairwise
import re

from hypothesis import example, given
from hypothesis import strategies as st
import pytest

from tendon_sensor_driver import encode_reading, LineDecoder, TendonSensorConfig
from tendon_sensor_driver.line_sensor import MAX_LINE_BYTES

CONFIG = TendonSensorConfig()
NO_TIME = {'time_column': -1, 'value_column': 0}
LINE = b'1204,0.53000,kg,\r\n'


def decode(data, config=CONFIG, *, is_opened_mid_line=False):
    decoder = LineDecoder(config)
    readings = decoder.feed(data if is_opened_mid_line else b'\n' + data, 7)
    return decoder, [(r.device_ticks, r.value) for r in readings]


# -- lines that are readings -------------------------------------------------------------


@pytest.mark.parametrize('end', [b'\n', b'\r', b'\r\n', b'\n\r', b'\r\r\n'])
def test_any_line_end(end):
    decoder, readings = decode(end.join([b'1,0.5,kg', b'2,0.6,kg', b'']))
    assert readings == [(1, 0.5), (2, 0.6)]
    assert decoder.rejected_lines == 0


@pytest.mark.parametrize(
    'line',
    [
        *b'12,0.5|12;0.5|12\t0.5|12 0.5|  12   0.5  |12, 0.5,|12 ; 0.5 ;;|12,.5'.split(b'|'),
        *(b'12,+0.5,kg,24.75,', b'12,5e-1,kg,lorem \xe9\xff ipsum', b'12,.5 | lorem'),
    ],
)
def test_any_separator_and_further_columns(line):
    assert decode(line + b'\n')[1] == [(12, 0.5)]


@pytest.mark.parametrize(
    ('line', 'options', 'reading'),
    [
        (b'1204,0.53,kg,24.75,', {}, (1204, 0.53)),  # OpenScale with temperature
        # OpenScale with all columns that it can send.
        (b'1204,0.53,kg,8388607,24.75,21.3,', {}, (1204, 0.53)),
        (b'12.3', NO_TIME, (None, 12.3)),
        (b'0.5,kg,99', {'time_column': 2, 'value_column': 0}, (99, 0.5)),
        (b'12.3,45', {**NO_TIME, 'line_columns': 2}, (None, 12.3)),
        (b'12.3,45,', {'time_column': -1, 'line_columns': 2}, (None, 45.0)),
        (b'Reading: 12.3 g', {'time_column': -1, 'unit': 'g'}, (None, 12.3)),
        (b'Reading: 12.3 lbs', {'time_column': -1, 'unit': 'lbf'}, (None, 12.3)),
        (b'Reading:12.3g', {**NO_TIME, 'unit': 'g'}, (None, 12.3)),
        (b'weight=-0.5kg', NO_TIME, (None, -0.5)),
        (b'12.3kg', NO_TIME, (None, 12.3)),
        (b'12.3 [N]', {**NO_TIME, 'unit': 'N'}, (None, 12.3)),
        (
            b'one reading:\t12.3\t| average:\t12.25000',
            {**NO_TIME, 'value_column': 2, 'unit': 'g'},
            (None, 12.3),
        ),
        (
            b'Load_cell output val: 12.30',
            {'time_column': -1, 'value_column': 3, 'unit': 'g'},
            (None, 12.3),
        ),
        (b'12\t0.5\tkg', {}, (12, 0.5)),
        (b'12.34 0.5', {'time_unit_s': 1.0, 'time_decimals': 2}, (1234, 0.5)),
        (b'1204,0.53,24', {'line_columns': 3}, (1204, 0.53)),
        (b'1,2,3', {'time_column': -1, 'line_columns': 3}, (None, 2.0)),
    ],
)
def test_the_forms_that_are_seen_on_load_cells(line, options, reading):
    decoder, readings = decode((line + b'\r\n') * 3, TendonSensorConfig(**options))
    # New words before the value are accepted only if the next line has them, too.
    assert readings in ([reading] * 3, [reading] * 2)
    assert decoder.rejected_lines == 3 - len(readings)


INDICATOR = {**NO_TIME, 'value_column': 2}


@pytest.mark.parametrize(
    ('lines', 'options'),
    [
        ([b'ST,GS,+  12.34 kg', b'US,GS,+  12.34 kg'], INDICATOR),  # scales of A&D, CAS and others
        ([b'ST,NT,   12.34,kg', b'US,NT,   12.34,kg'], INDICATOR),
        ([b'ST,GS,+  12.34kg', b'US,GS,+  12.34kg'], INDICATOR),
        ([b'ST,+00012.34  g', b'US,+00012.34  g'], {**INDICATOR, 'value_column': 1, 'unit': 'g'}),
        ([b'S S      12.34 g', b'S D      12.34 g'], {**INDICATOR, 'unit': 'g'}),  # Mettler SICS
        ([b'+   12.34 kg'], {**INDICATOR, 'value_column': 0}),
        ([b'N     +   12.34 g'], {**INDICATOR, 'value_column': 1, 'unit': 'g'}),  # Sartorius
    ],
)
@pytest.mark.parametrize('is_negative', [False, True])
def test_scale_indicators_with_words_that_alternate_are_read(lines, options, is_negative):
    if is_negative:
        lines = [
            line.replace(b'+', b'-') if b'+' in line else line.replace(b'   12', b'-  12')
            for line in lines
        ]
    stream = b''.join(line + b'\r\n' for _ in range(30) for line in lines)
    decoder, readings = decode(stream, TendonSensorConfig(**options))
    # New words before the value are accepted only if the next line has them, too.
    assert decoder.rejected_lines <= 1, decoder.last_reason
    assert {value for _, value in readings} == {-12.34 if is_negative else 12.34}


BESIDE = 'is next to its value: if the comma is a decimal mark, set decimal_mark'
OVERLOAD = 'the device reports an overload or an error: unload it'
REFUSED = [
    (b'12.34 mN/12.34mN', 'N', 'its unit is mN, but the parameter "unit" is N: set unit to mN'),
    (b'mN: 12.34/Force [mN]: 12.34', 'N', 'set unit to mN'),
    (b'0.01234 kN', 'N', 'set unit to kN'),
    (b'12.34 oz', 'g', 'set unit to oz'),
    (b'12.34 t', 'kg', 'set unit to t'),
    (b'12.34,,g/12.34 | g', 'kg', 'set unit to g'),
    (b'12.34,,N/12.34 | N/12.34 [N]', 'kg', 'set unit to N'),  # N is not "net" here
    (b'12.34 lbs', 'kg', 'set unit to lbf'),
    (b'12.34 units', 'kg', 'the word "units" after the value is not a known unit'),
    (b'12.34 \xb5N', 'N', 'the word "\\xb5N" after the value'),
    (b'12.34 %', 'g', 'the word "%" after the value'),
    (b'12.34 \x1b[31m', 'g', 'the word "\\x1b[31m" after the value'),
    (b'12,34/12,34,56/12,34 N/F:12,34N', 'N', BESIDE),
    (b'12 345.6 N/12,345.6/12 345/12 ,345', 'N', 'thousands separators are not supported'),
    (b'OL/OL,GS,+  12.34 kg/12.34 kg Overload', 'kg', OVERLOAD),
    (b'OL,+999999.9 g/S +/S -', 'g', OVERLOAD),
    (b'reading', 'kg', 'its value_column holds no number'),
]


@pytest.mark.parametrize(
    ('line', 'unit', 'reason'),
    [(line, unit, reason) for lines, unit, reason in REFUSED for line in lines.split(b'/')],
)
def test_a_line_that_may_hold_another_value_is_refused_with_the_remedy(line, unit, reason):
    numbers = [i for i, text in enumerate(line.replace(b',', b' ').split()) if b'12' in text]
    column = numbers[0] if numbers else 0
    config = TendonSensorConfig(time_column=-1, value_column=column, unit=unit)
    decoder, readings = decode((line + b'\n') * 5, config)
    assert readings == []
    assert decoder.rejected_lines == 5
    assert reason in decoder.last_reason


@pytest.mark.parametrize(
    ('line', 'options', 'reading'),
    [
        (b'12,34', NO_TIME, (None, 12.34)),
        (b'-0,5 kg', NO_TIME, (None, -0.5)),
        (b'1204;0,53;kg', {}, (1204, 0.53)),
        (b'1204 0,53', {}, (1204, 0.53)),
        (b'12,04;0,53', {'time_unit_s': 1.0, 'time_decimals': 2}, (1204, 0.53)),
        (b'ST,GS,+  12,34kg', INDICATOR, (None, 12.34)),
        (b'ST, GS, -  12,34, kg', INDICATOR, (None, -12.34)),
    ],
)
def test_a_decimal_comma_is_read_where_it_is_configured(line, options, reading):
    config = TendonSensorConfig(decimal_mark=',', **options)
    assert decode((line + b'\n') * 3, config)[1][-1] == reading


@pytest.mark.parametrize(
    ('line', 'mark', 'readings'),
    [
        *((line, ',', []) for line in (b'1.234,5', b'12.34', b'12,34,56')),
        (b'12,34', '.', []),
    ],
)
def test_the_other_mark_separates_columns_or_makes_no_number(line, mark, readings):
    config = TendonSensorConfig(**NO_TIME, decimal_mark=mark)
    assert decode((line + b'\n') * 3, config)[1] == readings


@pytest.mark.parametrize('line', [b',5 kg', b'-,5 kg', b'- ,5 kg', b'F:,5 kg', b'7 ,5 kg'])
@pytest.mark.parametrize('value_column', [0, 1])
def test_a_comma_that_may_be_a_column_or_a_decimal_mark_is_refused(line, value_column):
    config = TendonSensorConfig(time_column=-1, value_column=value_column, decimal_mark=',')
    assert decode((line + b'\n') * 3, config)[1] == []


@pytest.mark.parametrize(
    ('line', 'mark'),
    [(b'ST,GS,-,12.3 kg', '.'), (b'ST;GS;-;12,3 kg', ','), (b'ST GS -;12.3', '.')],
)
def test_a_value_whose_sign_is_in_another_column_is_refused(line, mark):
    config = TendonSensorConfig(time_column=-1, value_column=3, decimal_mark=mark, unit='kg')
    decoder, readings = decode((line + b'\n') * 3, config)
    assert readings == []
    assert 'sign' in decoder.last_reason
    assert decode((line.replace(b'-', b'+') + b'\n') * 3, config)[1]


def test_a_simulated_device_says_so_in_each_line():
    decoder = LineDecoder(CONFIG)
    lines = [encode_reading(17 * i, 0.5, is_simulated=True) for i in range(3)]
    assert lines[0] == b'0,0.50000,kg,SIMULATED,\r\n'
    readings = decoder.feed(b'\n' + b''.join(lines) + LINE, 7)
    assert [reading.simulated for reading in readings] == [True, True, True]
    assert decoder.last_reason.startswith('its columns or words differ')


def test_a_banner_that_looks_like_a_reading_is_none():
    config = TendonSensorConfig(time_column=-1, unit='g')
    data = b'Version: 1.2\r\nReading: 5.0 g\r\nReading: 5.1 g\r\nReading: 5.2 g\r\n'
    assert decode(data, config)[1] == [(None, 5.1), (None, 5.2)]


# -- lines that are not ----------------------------------------------------------------------


NOT_FINITE_OR_PLAIN = (
    b'|nan|inf|-infinity|1e999|1e16|1_0|0x1f|1.2.3|--1|1e|.|\xd9\xa1|\xd9\xa3|0.5\x00'.split(b'|')
)


@pytest.mark.parametrize(
    'line', [*(b'12,%s,kg' % value for value in NOT_FINITE_OR_PLAIN), b'12,,1,kg']
)
def test_what_is_no_plain_finite_number_is_rejected(line):
    decoder, readings = decode(line + b'\n')
    assert readings == []
    assert (decoder.rejected_lines, decoder.last_rejected) == (1, line)


@pytest.mark.parametrize(
    ('texts', 'form', 'options'),
    [
        (b'|-1|1.5|+1|1_0|1e3|' + b'9' * 20, b'%s,0.5,kg', {}),
        (b'12|12.3|12.345|.34|-1.23|1e2', b'%s 0.5', {'time_unit_s': 1.0, 'time_decimals': 2}),
        (
            b'12.3lbs|Reading:12.3lbs|12.3x|a1:12.3|1e5e',
            b'%s',
            {**NO_TIME, 'unit': 'g'},
        ),
    ],
    ids=['no count', 'other decimals', 'unknown words at the value'],
)
def test_a_time_or_value_in_another_form_is_rejected(texts, form, options):
    for text in texts.split(b'|'):
        assert decode((form % text + b'\n') * 3, TendonSensorConfig(**options))[1] == [], text


def test_the_banner_is_skipped_and_counted():
    banner = (
        b'\r\nSerial Load Cell Converter version 1.2\r\nBy SparkFun Electronics\r\n'
        b'Minimum time between reports: 14\r\nPress x to bring up settings\r\nReadings:\r\n'
    )
    decoder, readings = decode(banner + LINE)
    assert readings == [(1204, 0.53)]
    assert (decoder.lines, decoder.readings, decoder.rejected_lines) == (6, 1, 5)


def test_a_reading_after_dropped_bytes_says_so():
    decoder = LineDecoder(CONFIG)
    readings = decoder.feed(b'04,0.5,kg,\n' + LINE + b'what?\n' + LINE + LINE, 7)
    assert [r.resynchronised for r in readings] == [False, True, False]


def test_the_line_that_the_port_was_opened_in_is_dropped_but_not_held_against_it():
    decoder, readings = decode(b'4,0.53000,kg,\r\n' + LINE, is_opened_mid_line=True)
    assert readings == [(1204, 0.53)]
    assert decoder.rejected_lines == 0
    decoder.feed(b'1221,0.5', 8)
    decoder.reset()
    assert decoder.feed(b'4000,kg,\r\n', 9) == []
    assert decoder.rejected_lines == 0


@pytest.mark.parametrize('length', range(1, len(LINE) - 2))
def test_a_cut_line_is_no_reading(length):
    decoder, readings = decode(LINE + LINE[:length] + b'\r\n' + LINE)
    assert readings == [(1204, 0.53)] * 2
    assert decoder.rejected_lines == 1


@pytest.mark.parametrize('kept', range(1, len(LINE)))
def test_two_lines_melted_into_one_give_no_value_of_neither(kept):
    _, readings = decode(LINE + LINE[:kept] + b'1221,0.64000,kg,\r\n' + LINE)
    assert {value for _, value in readings} <= {0.53, 0.64}


def test_a_device_with_new_columns_is_believed_from_the_second_line_on():
    decoder, readings = decode(b'1,0.5,kg,\n' + b'2,0.6,kg,24.5,\n' * 3)
    assert readings == [(1, 0.5), (2, 0.6), (2, 0.6)]
    assert decoder.rejected_lines == 1


def test_an_endless_line_costs_one_count_and_no_memory():
    decoder = LineDecoder(CONFIG)
    decoder.feed(b'\n', 1)
    for _ in range(1000):
        assert decoder.feed(b'7' * 999, 1) == []
        assert len(decoder._rest) <= MAX_LINE_BYTES
    assert [r.value for r in decoder.feed(b'7\n' + LINE, 2)] == [0.53]
    assert decoder.rejected_lines == 1
    assert decoder.bytes == 1 + 1000 * 999 + 2 + len(LINE)


# -- any bytes --------------------------------------------------------------------------------

WORDS = [
    *b'12|0.5|-3|1e2|1_0|nan|,|,|;|\t| |kg|kg|g|lbs|+ |- |OL|12,34|SIMULATED'.split(b'|'),
    *b'\n|\n|\r|\r\n|\xff|\x00'.split(b'|'),
]
pieces = st.sampled_from([*WORDS, LINE, LINE, b'x' * 300, b' ' * 250])
streams = st.lists(pieces | st.binary(max_size=8), max_size=40).map(b''.join)


@given(streams, st.lists(st.integers(0, 2000), max_size=30))
@example(b'\n' + b'x' * 257 + b'\n' + LINE, [200])
@example(b'\n' + b' ' * 257 + b'\n' + LINE, [258])
def test_the_chunking_makes_no_difference(data, cuts):
    whole = LineDecoder(CONFIG)
    expected = whole.feed(data, 7)
    bounds = [0, *sorted(min(cut, len(data)) for cut in cuts), len(data)]
    for step in (bounds, range(len(data) + 1)):
        split = LineDecoder(CONFIG)
        readings = []
        for start, end in pairwise(step):
            readings += split.feed(data[start:end], 7)
        assert readings == expected
        for counter in ('bytes', 'lines', 'readings', 'last_rejected', 'rejected_lines'):
            assert getattr(split, counter) == getattr(whole, counter)


# -- dialects ---------------------------------------------------------------------------------

DIALECTS = {
    'OpenScale': ('{time},{value},{unit},24.75,', 0, 1),
    'bare': ('{value}', -1, 0),
    'named': ('Weight:{value}{unit}', -1, 0),
    'sketch': ('Reading: {value} {unit}', -1, 1),
    'seconds': ('{time} {value}', 0, 1),
    'A&D': ('{stable},GS,{value:>8}{unit:>3}', -1, 2),
    'Mettler SICS': ('S {letter} {value:>10} {unit}', -1, 2),
    'apart': ('{sign} {digits:>8} {unit}', -1, 0),
}


@given(
    st.sampled_from(sorted(DIALECTS)),
    st.sampled_from(['kg', 'g', 't', 'N', 'mN', 'kN', 'lbf', 'oz']),
    st.sampled_from(['.', ',']),
    st.lists(st.tuples(st.booleans(), st.integers(-(10**7), 10**7)), min_size=4, max_size=12),
    st.integers(1, 5),
)
def test_a_line_of_a_dialect_is_read_exactly_or_refused(dialect, unit, mark, samples, decimals):
    form, time_column, value_column = DIALECTS[dialect]
    if mark == ',' and dialect == 'OpenScale':
        form = form.replace(',', ';').replace('24.75', '24,75')
    config = TendonSensorConfig(
        time_column=time_column, value_column=value_column, unit=unit, decimal_mark=mark
    )
    decoder = LineDecoder(config)
    decoder.feed(b'\n', 0)
    refused = 0
    for i, (is_stable, count) in enumerate(samples):
        text = f'{count / 10**decimals:+.{decimals}f}'
        value = text.replace('.', ',') if mark == ',' else text
        line = form.format(
            time=17 * i,
            value=value,
            sign=value[0],
            digits=value[1:],
            unit='lbs' if unit == 'lbf' else unit,
            stable='ST' if is_stable else 'US',
            letter='SD'[is_stable],
        )
        readings = decoder.feed(line.encode() + b'\r\n', i)
        expected = 17 * i if time_column >= 0 else None
        assert [(r.device_ticks, r.value) for r in readings] in ([], [(expected, float(text))])
        refused += not readings
    assert refused <= 1, decoder.last_reason


@given(
    st.sampled_from(['.', ',']),
    st.integers(-1, 2),
    st.integers(0, 3),
    st.sampled_from(['kg', 'N', 'g']),
    st.lists(
        st.sampled_from(
            b'ST|US|S|D|GS|+|-| |,|;|.|1|12|0.5|12,34|1,234.5|kg|g|N|mN|:|=|OL|\n|\n|\r\n'.split(
                b'|'
            )
        )
        | st.binary(max_size=3),
        max_size=60,
    ).map(b''.join),
)
@example('.', -1, 0, 'kg', b'0 1')
@example(',', -1, 1, 'kg', b',1')
@example(',', -1, 1, 'kg', b'ST,1')
def test_a_value_stands_in_its_line_as_it_is_given(mark, time_column, value_column, unit, data):
    if time_column == value_column:
        time_column = -1
    config = TendonSensorConfig(
        time_column=time_column, value_column=value_column, unit=unit, decimal_mark=mark
    )
    for line in data.replace(b'\r', b'\n').split(b'\n'):
        decoder = LineDecoder(config)
        for reading in decoder.feed(b'\n' + (line + b'\n') * 2, 7):
            text = re.sub('([+-]) +', r'\1', line.decode('latin-1'))
            if mark == ',':  # any other comma separates columns
                text = re.sub(r'(?<=\d),(?=\d)', '.', text)
            # The value must be a whole number in the line, not a part of a longer number.
            numbers = re.findall(r'(?<![\d.])[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?', text)
            assert abs(reading.value) in [abs(float(number)) for number in numbers]
            if len(numbers) == 1:
                behind = re.split(r'[\d.]+', text)[-1]
                assert not re.fullmatch(r'[,; \t]*(kg|g|N|mN)[,; \t]*', behind) or unit in behind


@given(
    st.integers(1, 999),
    st.integers(0, 999),
    st.sampled_from([',', ' ', '\t', ', ', ';', ' ,']),
    st.sampled_from([',kg', ' kg', 'kg', '', ',kg,24.75,']),
    st.booleans(),
)
@example(12, 34, ',', ',kg', True)
@example(1, 234, ' ', ' kg', False)
def test_a_number_that_is_divided_is_never_read(head, tail, mark, end, has_time):
    """A mark within a number can be a decimal comma or a thousands separator."""
    config = CONFIG if has_time else TendonSensorConfig(**NO_TIME)
    time = '1204,' if has_time else ''
    for sign in ('', '-', '+'):
        line = f'{time}{sign}{head}{mark}{tail:03d}{end}\n'.encode()
        assert decode(line * 3, config)[1] == []


@given(st.integers(1, 6), st.integers(1, 6))
def test_with_a_stated_number_of_columns_no_other_line_is_read(stated, count):
    config = TendonSensorConfig(**NO_TIME, line_columns=stated)
    line = ','.join(str(i) for i in range(count)).encode()
    decoder, readings = decode((line + b'\n') * 3, config)
    assert readings == ([(None, 0.0)] * 3 if stated == count else [])
    assert (decoder.rejected_lines == 0) == (stated == count)


# -- encode ---------------------------------------------------------------------------------------


def test_encode_writes_the_line_of_an_openscale():
    assert encode_reading(1204, 0.53) == LINE
    assert encode_reading(None, -1.5, 'lbf', 2) == b'-1.50,lbs,\r\n'
    with pytest.raises(ValueError, match='finite'):
        encode_reading(0, float('nan'))


@given(
    st.none() | st.integers(0, 2**32 - 1),
    st.floats(-1e6, 1e6),
    st.sampled_from(['kg', 'g', 'N', 'lbf']),
    st.integers(0, 9),
)
def test_what_encode_writes_decode_reads(ticks, value, unit, decimals):
    time_column = -1 if ticks is None else 0
    config = TendonSensorConfig(time_column=time_column, value_column=time_column + 1, unit=unit)
    _, readings = decode(encode_reading(ticks, value, unit, decimals), config)
    assert readings == [(ticks, float(f'{value:.{decimals}f}'))]
