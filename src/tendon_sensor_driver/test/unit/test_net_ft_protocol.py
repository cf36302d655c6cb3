# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import struct

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from tactile_ros.strain import StrainStatus
from tendon_sensor_driver.net_ft_protocol import (
    classify_status,
    Command,
    compute_rate_hz,
    decode_records,
    encode_request,
    format_status,
)

WORDS = st.integers(0, 2**32 - 1)
COUNTS = st.lists(st.integers(-(2**31), 2**31 - 1), min_size=6, max_size=6)


def test_the_requests_are_the_known_good_bytes():
    assert encode_request(Command.START_REALTIME).hex() == '1234000200000000'
    assert encode_request(Command.STOP).hex() == '1234000000000000'


@given(st.lists(st.tuples(WORDS, WORDS, WORDS, COUNTS), min_size=1, max_size=40))
def test_records_are_read_as_struct_reads_them(rows):
    datagram = b''.join(struct.pack('>III6i', a, b, c, *counts) for a, b, c, counts in rows)
    records = decode_records(datagram)
    assert [
        (int(r['rdt_sequence']), int(r['ft_sequence']), int(r['status']), r['counts'].tolist())
        for r in records
    ] == rows


@pytest.mark.parametrize(
    ('word', 'is_axia', 'status', 'words'),
    [
        (0, False, StrainStatus.OK, ()),
        (0x80010000, False, StrainStatus.OK, ('monitor condition latched',)),
        (0x80020000, False, StrainStatus.SATURATED, ('transducer saturated or A/D error',)),
        (0x80000040, False, StrainStatus.DEVICE_ERROR, ('analog supply too high',)),
        (0x80000000, False, StrainStatus.DEVICE_ERROR, ('an error without a reason',)),
        (
            0x80020004,
            False,
            StrainStatus.SATURATED | StrainStatus.DEVICE_ERROR,
            ('transducer saturated or A/D error', 'temperature'),
        ),
        (
            0x88000000,
            False,
            StrainStatus.DEVICE_ERROR,
            ('serial link between transducer and board',),
        ),
        (0x88000000, True, StrainStatus.SATURATED, ('gauge out of range',)),
        (0xC0000000, True, StrainStatus.SATURATED, ('force or torque out of range',)),
        (0x80000004, True, StrainStatus.DEVICE_ERROR, ('broken gauge',)),
    ],
)
def test_status_words_become_bits_and_words(word, is_axia, status, words):
    bits = classify_status(np.array([0, word], dtype=np.uint32), is_axia=is_axia)
    assert bits.tolist() == [0, int(status)]
    assert format_status(word, is_axia=is_axia) == words


@given(WORDS, st.booleans())
def test_every_status_word_has_words(word, is_axia):
    assert (format_status(word, is_axia=is_axia) == ()) == (word == 0)


@pytest.mark.parametrize(
    ('asked_hz', 'made_hz'),
    [(60, 7000 / 116), (1000, 1000), (150, 7000 / 46), (4000, 7000), (7000, 7000), (9000, 7000)],
)
def test_the_rate_is_the_next_fraction_of_7000(asked_hz, made_hz):
    assert compute_rate_hz(asked_hz) == pytest.approx(made_hz, rel=1e-12)
